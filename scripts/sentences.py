"""Lengths of the sentences of Markdown documents."""

import math
import re


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


def percentile(counts, share):
    """The smallest of ascending counts that this share of them does not exceed."""
    return counts[max(math.ceil(share * len(counts)), 1) - 1]
