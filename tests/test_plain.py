"""Pages that people read from the first line to the last: short pages of short sentences."""

import re

import pytest

from tests.snippets import BLOCK, pages

GENERATED = ("messages.md", "scenario.md")
PAGES = sorted(set(pages()) - set(GENERATED))
#: Notes of what was measured: tables of numbers, with long sentences between them.
NOTES = [name for name in PAGES if name.startswith("notes/")]
PLAIN = sorted(set(PAGES) - set(NOTES))
MOST_WORDS = 1500  # of a page
TOGETHER = 25_000  # words of all pages without the notes and what is made from code
MOST, MEAN = 25, 14  # words of a sentence


def sentences(page: str) -> list[str]:
    """The sentences of a page: without code, tables, headings and the addresses of links."""
    text = BLOCK.sub("\n", pages()[page])
    text = re.sub(r"^(#|\||:::|!\[).*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"`[^`]*`", "code", text)
    parts = []
    for paragraph in re.split(r"\n\s*\n|\n(?=- )", text):
        parts += [
            part for part in re.split(r"(?<=[.!?])[\"*)]*\s+", " ".join(paragraph.split())) if re.search(r"\w", part)
        ]
    return parts


@pytest.mark.parametrize("page", PLAIN)
def test_sentences_are_short(page: str) -> None:
    long = [sentence for sentence in sentences(page) if len(sentence.split()) > MOST]
    assert long == []
    lengths = [len(sentence.split()) for sentence in sentences(page)]
    assert sum(lengths) <= MEAN * len(lengths)


@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_read_in_minutes(page: str) -> None:
    assert len(pages()[page].split()) <= MOST_WORDS


def test_all_pages_together_are_read_in_an_afternoon() -> None:
    assert sum(len(pages()[page].split()) for page in PLAIN if page != "api.md") <= TOGETHER


@pytest.mark.parametrize("page", sorted(set(NOTES) - {"notes/mutants.md"}))
def test_a_note_says_that_its_numbers_are_not_made_again(page: str) -> None:
    assert "of their day" in " ".join(pages()[page].split())


def test_the_readme_fits_a_screen_or_two() -> None:
    assert len(pages()["README.md"].splitlines()) <= 60
