"""Pictures of the star camera as files, with their truth, for star trackers of other people and for `solve`.

flown                            the frames of a flight, flown for them, or flown again from its log
header                           what is told with a picture
truth                            what it really shows, as a table
camera_file                      the camera as `solve --camera` takes it; its star tracker, if it says none
export                           a folder of all that, PNG or FITS
"""
