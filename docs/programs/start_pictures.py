"""Pictures of the Start and How-to pages: the pages' own commands draw them, in docs/generated/demo."""

from __future__ import annotations

import shutil
from pathlib import Path

from shown import Pages, program_folder

from ocisac_fast import demo


def draw(docs: Path) -> None:
    """Run the demo and every page that shows a picture of docs/generated, and keep these pictures."""
    generated = docs / "generated"
    demo.run(generated / "demo")
    pages = Pages(generated / "demo", program_folder(generated / "programs"))
    for page in sorted([*(docs / "start").glob("*.md"), *(docs / "howto").glob("*.md")]):
        shown = page.read_text(encoding="utf-8").split("../generated/pictures/")[1:]
        if not shown:
            continue
        folder = generated / "pages"
        shutil.rmtree(folder, ignore_errors=True)
        pages.run(page, folder)
        for text in shown:
            name = text.partition(")")[0]
            (generated / "pictures").mkdir(exist_ok=True)
            shutil.copy(folder / page.stem / name, generated / "pictures" / name)
    shutil.rmtree(generated / "demo")
    shutil.rmtree(generated / "pages", ignore_errors=True)
