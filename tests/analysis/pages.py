"""What a page of a report would fetch from elsewhere, which is nothing if it stands alone; and what a page of Markdown says."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

from analysis.experiment import ROOT

#: Every page of the project.
PAGES = sorted(
    page
    for pattern in ("*.md", ".github/*.md", "[a-z]*/*.md", "tests/*/*.md")
    for page in ROOT.glob(pattern)
    if page.relative_to(ROOT).parts[0] not in ("build", "out")
)

_FETCHED = {"src", "srcset", "data", "poster", "background", "xlink:href"}  # of any tag


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            is_fetched = name in _FETCHED or (name == "href" and tag != "a")
            if is_fetched and value and not value.startswith(("data:", "#")):
                self.found.append(value)

    def handle_data(self, data: str) -> None:
        if self.cdata_elem or (self.lasttag in ("style", "script")):
            self.found += re.findall(
                r"""@import[^;]*|url\(\s*['"]?(?!data:|#)[^)]*|https?://[^\s"']*""", data
            )


def fetched(page: str) -> list[str]:
    """Addresses that a browser would ask for as it shows the page, those within its SVG pictures included."""
    pictures = re.findall(r"data:image/svg\+xml;base64,([A-Za-z0-9+/=]+)", page)
    texts = [page, *(base64.b64decode(picture).decode() for picture in pictures)]
    found = []
    for text in texts:
        reader = _Reader()
        reader.feed(text)
        found += reader.found + re.findall(r"""url\(\s*['"]?(?!data:|#|&)(?=[^)])[^)]*""", text)
    return found


def sentences(markdown: str) -> list[str]:
    """Of the prose alone: no code, formulas in blocks, tables, headings or references; a formula in a line is a word."""
    text = re.sub(r"```.*?```", "\n", markdown, flags=re.DOTALL).split("\n## References\n")[0]
    text = re.sub(r"^(    .*|\|.*|#.*)$", "", text, flags=re.MULTILINE)
    text = re.sub(r"!\[[^]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"`[^`]+`|\$[^$]+\$", "code", text)
    blocks = re.split(r"\n\s*\n|\n\s*(?:-|\d+\.) ", text)
    parts = [part for block in blocks for part in re.split(r"(?<=[.!?])[*\")\]]*\s+", block)]
    return [" ".join(part.split()) for part in parts if part.strip()]


def n_words(sentence: str) -> int:
    return sum(bool(re.search(r"\w", word)) for word in sentence.split())


def links(markdown: str) -> list[tuple[str, str]]:
    """Files and anchors that a page links to or shows, addresses on the web left out."""
    text = re.sub(r"```.*?```", "", markdown, flags=re.DOTALL)
    found = re.findall(r"\]\(([^)#\s]*)#?([^)\s]*)\)", text)
    return [(file, anchor) for file, anchor in found if not file.startswith(("http:", "https:"))]


def anchors(markdown: str) -> set[str]:
    """Of the headings, as GitHub makes them."""
    heads = re.findall(r"^#+ (.*)$", markdown, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


_KEY = re.compile(r"((?:[Vv]an (?:der )?)?[A-Z]\w+)(?:, [\w ]+)*(?: & [\w ]+| et al\.)? ((?:18|19|20)\d\d)\b")


def citations(text: str) -> set[tuple[str, str]]:
    """First author and year of all that stands in brackets as [Author & Author 1999], comments over lines included."""
    joined = re.sub(r"\n[ \t]*(?:///?|#)? ?", " ", text)
    inside = re.findall(r"\[([^][]{6,200})\]", joined)
    return {key for bracket in inside for key in _KEY.findall(bracket)}


def references(markdown: str) -> dict[tuple[str, str], str]:
    """What a page's list of references says of each first author and year."""
    listed = markdown.partition("\n## References\n")[2]
    entries = re.findall(r"^- (\[[^]]+\])(.*)$", listed, re.MULTILINE)
    return {key: bracket + text for bracket, text in entries for key in citations(bracket)}
