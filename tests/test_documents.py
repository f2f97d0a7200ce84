"""Documents are short to read: sentences of some 25 words, a README of two screens, a changelog of ten lines a release."""

import math
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
NAMES = ["README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "TESTING.md", "CHANGELOG.md"]
# Pages in docs/bench are generated.
DOCUMENTS = [ROOT / name for name in NAMES] + sorted((ROOT / "docs").glob("*.md"))

MOST_WORDS = 25
MOST_README_LINES = 119
MOST_BULLETS = 10


def plain(text):
    """Text of Markdown without code blocks, pictures, and targets of links; inline code is one word."""
    text = re.sub(r"^( *)```.*?^\1```$", "", text, flags=re.M | re.S)
    text = re.sub(r"!\[[^]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", text)
    return re.sub(r"`[^`]*`", "code", text)


def blocks(text):
    """Paragraphs, list items and table cells of Markdown. Headings and the lines below table headers are left out."""
    lines = []
    for line in [*plain(text).splitlines(), ""]:
        stripped = line.strip()
        is_row = stripped.startswith("|")
        is_item = re.match(r"([-*]|\d+\.) ", stripped) is not None
        if lines and (not stripped or is_row or is_item or stripped.startswith("#")):
            yield " ".join(lines)
            lines = []
        if is_row:
            if not re.fullmatch(r"[|:\- ]+", stripped):
                yield from (cell.strip() for cell in stripped.strip("|").split("|"))
        elif stripped and not stripped.startswith("#"):
            lines.append(re.sub(r"^([-*]|\d+\.) ", "", stripped))


def sentences(text):
    """Sentences of Markdown. A table cell is one, however many full stops it has."""
    rows = "\n".join(line for line in text.splitlines() if line.lstrip().startswith("|"))
    prose = "\n".join("" if line.lstrip().startswith("|") else line for line in text.splitlines())
    yield from blocks(rows)
    for block in blocks(prose):
        yield from re.split(r"(?<=[.!?])[)*_\"]*\s+", block)


def lengths(text):
    """Words of each sentence, in ascending order."""
    counts = (len(re.findall(r"\S*\w\S*", sentence)) for sentence in sentences(text))
    return sorted(count for count in counts if count)


def percentile_90(counts):
    """The smallest count that nine tenths do not exceed."""
    return counts[math.ceil(0.9 * len(counts)) - 1]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_nine_sentences_of_ten_are_short(path):
    text = path.read_text()
    longest = max(sentences(text), key=lambda sentence: len(sentence.split()))
    assert percentile_90(lengths(text)) <= MOST_WORDS, f"the longest: {longest}"


def test_readme_is_two_screens():
    assert len((ROOT / "README.md").read_text().splitlines()) <= MOST_README_LINES


def test_a_release_has_at_most_ten_bullets():
    releases = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(), flags=re.M)[1:]
    assert releases
    for release in releases:
        bullets = re.findall(r"^ *[-*] ", release, re.M)
        assert len(bullets) <= MOST_BULLETS, release.splitlines()[0]


def test_words_are_counted_as_they_are_read():
    text = "# Not this\n\nOne `two words` three.\nFour five! Six\n\n```\ncode here\n```\n- a [b](c d e) f\n\n| x y | z. w |\n| - | - |\n"
    assert lengths(text) == [1, 2, 2, 2, 3, 3]
