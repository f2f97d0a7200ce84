"""Puts the photographs that `make window WINDOW=guide` has left into docs/images/guide, smaller."""

from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
WIDTH, QUALITY = 1280, 85


def main():
    """See the first line of this file."""
    folder = ROOT / "docs" / "images" / "guide"
    folder.mkdir(parents=True, exist_ok=True)
    for picture in sorted((ROOT / "out" / "window").glob("guide-*.png")):
        image = Image.open(picture)
        image = image.resize((WIDTH, image.height * WIDTH // image.width), Image.Resampling.LANCZOS)
        image.save(folder / f"{picture.stem.removeprefix('guide-')}.jpg", quality=QUALITY, optimize=True)


if __name__ == "__main__":
    main()
