"""The check of pages finds what it is there to find."""

import base64

import pytest
from pages import fetched

SVG = base64.b64encode(
    b'<svg xmlns="http://www.w3.org/2000/svg"><image xlink:href="http://a.org/b.png"/></svg>'
).decode()


@pytest.mark.parametrize(
    "page",
    [
        '<img src="http://a.org/b.png">',
        '<img src="b.png">',
        '<link rel="stylesheet" href="b.css">',
        '<script src="https://a.org/b.js"></script>',
        "<style>@import 'b.css';</style>",
        "<style>p { background: url(http://a.org/b.png) }</style>",
        "<script>fetch('https://a.org')</script>",
        f'<img src="data:image/svg+xml;base64,{SVG}">',
    ],
)
def test_what_is_fetched_is_found(page):
    assert fetched(page)


def test_links_namespaces_and_data_are_not_fetched():
    plain = base64.b64encode(
        b'<svg xmlns="http://www.w3.org/2000/svg"><path clip-path="url(#p)"/></svg>'
    ).decode()
    assert not fetched(
        f'<p>see http://a.org <a href="http://a.org">there</a> <img src="data:image/svg+xml;base64,{plain}"></p>'
    )
