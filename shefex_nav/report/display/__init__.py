"""The star camera's frames on a screen, for a camera on a test bench.

player   which frame is shown when, which dots of the screen it fills, how bright; the page that shows them
"""
