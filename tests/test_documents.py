"""Documents are quick to read (short sentences, a short README and changelog), and name files that exist."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

sys.path.insert(0, str(ROOT / "scripts"))
from sentences import lengths, percentile, sentences, words  # noqa: E402

NAMES = ["README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "TESTING.md", "CHANGELOG.md"]
# Pages in docs/bench are generated.
DOCUMENTS = [ROOT / name for name in NAMES] + sorted((ROOT / "docs").glob("*.md"))

# Whose files documents name by their path in the repository.
FOLDERS = ["addon", "blend_tests", "docs", "examples", "rust", "scripts", "shaders", "tests"]

MOST_WORDS = 25
MOST_README_LINES = 119
MOST_BULLETS = 10


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_nine_sentences_of_ten_are_short(path):
    text = path.read_text()
    longest = max(sentences(text), key=words)
    assert percentile(lengths(text), 0.9) <= MOST_WORDS, f"the longest: {longest}"


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
