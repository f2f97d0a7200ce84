"""Documents are quick to read (short sentences, a short README and changelog), and name files that exist."""

import math
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
NAMES = ["README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "TESTING.md", "CHANGELOG.md"]
# Pages in docs/bench are generated.
DOCUMENTS = [ROOT / name for name in NAMES] + sorted((ROOT / "docs").glob("*.md"))

# Whose files documents name by their path in the repository.
FOLDERS = ["addon", "blend_tests", "docs", "examples", "rust", "scripts", "shaders", "tests"]

MOST_WORDS = 25
MOST_README_LINES = 119
MOST_BULLETS = 10


def plain(text):
    """Text of Markdown without code blocks, pictures, and targets of links; inline code is one word."""
    text = re.sub(r"^( *)```.*?^\1```$", "", text, flags=re.M | re.S)
    text = re.sub(r"!\[[^]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", text)
    return re.sub(r"`[^`]*`", "code", text)


def sentences(text):
    """Sentences of Markdown without its headings. A table cell is one, however many full stops it has."""
    lines = []
    for line in [*(line.strip() for line in plain(text).splitlines()), ""]:
        is_row, is_heading = line.startswith("|"), line.startswith("#")
        item = re.match(r"([-*]|\d+\.) ", line)
        if not line or is_row or is_heading or item:
            yield from re.split(r"(?<=[.!?])[)*_\"]*\s+", " ".join(lines))
            lines = []
        if is_row:
            yield from (cell.strip() for cell in line.split("|"))
        elif not is_heading:
            lines.append(line[item.end() :] if item else line)


def words(sentence):
    """Number of words; signs alone, such as arrows, are none."""
    return len(re.findall(r"\S*\w\S*", sentence))


def lengths(text):
    """Words of each sentence, in ascending order."""
    return sorted(filter(None, map(words, sentences(text))))


def percentile_90(counts):
    """The smallest count that nine tenths do not exceed."""
    return counts[math.ceil(0.9 * len(counts)) - 1]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_nine_sentences_of_ten_are_short(path):
    text = path.read_text()
    longest = max(sentences(text), key=words)
    assert percentile_90(lengths(text)) <= MOST_WORDS, f"the longest: {longest}"


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_files_that_are_named_exist(path):
    text = path.read_text()
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text)
    named = re.findall(rf"`((?:{'|'.join(FOLDERS)})/[\w./-]+)`", text)
    missing = [name for name in links if not (path.parent / name).exists()]
    missing += [name for name in named if not (ROOT / name).exists()]
    assert not missing


def test_readme_is_two_screens():
    assert len((ROOT / "README.md").read_text().splitlines()) <= MOST_README_LINES


def test_a_release_has_at_most_ten_bullets():
    releases = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(), flags=re.M)[1:]
    assert releases
    for release in releases:
        bullets = re.findall(r"^ *[-*] ", release, re.M)
        assert len(bullets) <= MOST_BULLETS, release.splitlines()[0]


def test_words_are_counted_as_they_are_read():
    prose = "# Not this\n\nOne `two words` three.\nFour five! Six\n\n```\ncode here\n```\n- a [b](c d e) f\n"
    assert lengths(prose) == [1, 2, 3, 3]
    assert lengths("| a b | c. d e |\n| --- | --- |\n| f | |\n") == [1, 2, 3]
