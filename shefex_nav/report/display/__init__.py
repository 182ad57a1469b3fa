"""The star camera's frames on a screen, for a camera on a test bench.

optics   which dots of the screen a frame fills, and how bright
player   which frame is shown when; the frames as the screen gets them
server   the page in a browser on this machine that shows them
"""
