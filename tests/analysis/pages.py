"""What a page would fetch from elsewhere: nothing, if it stands alone."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

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
