"""Takes the pictures of a run and of the viewer in the documents: python docs/take_pictures.py LOG

LOG is one of `shefex-nav run scenarios/shefex2_andoya.yaml`. No screen is needed, but a Vulkan driver.
"""

import sys
from pathlib import Path

from shefex_nav.report import viewer
from shefex_nav.report.figures import style
from shefex_nav.report.viewer import layout
from shefex_nav.runs import open_run

IMAGES = Path(__file__).parent / "images"
AT_S = 300.0  # in the middle of the star tracker's window


def main(log):
    """Write one PNG of the run at a glance, and one for each page of the viewer."""
    style.save(open_run(log).glance(AT_S), IMAGES / "glance.png", dpi=130)
    for page in layout.PAGES:
        name = "viewer" if page == layout.OVERVIEW else f"viewer-{page.lower().replace(' ', '-')}"
        picture = IMAGES / f"{name}.png"
        picture.unlink(missing_ok=True)
        viewer.view(log, screenshot=picture, at_s=AT_S, page=page)
        print(picture)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
