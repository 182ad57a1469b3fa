"""The star camera's frames on a screen, for a camera on a test bench.

player   the frames as the screen gets them: which is shown when, which dots it fills, how bright
server   the page in a browser on this machine that shows them
"""
