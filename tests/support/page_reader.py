"""A page's elements and texts, for tests that read it."""

from __future__ import annotations

from html.parser import HTMLParser


class Reader(HTMLParser):
    """Every element as (tag, attributes, text below it)."""

    VOID = frozenset({"meta", "img", "input", "br", "wbr", "line", "circle", "rect"})

    def __init__(self, text):
        super().__init__()
        self.elements, self._open = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        element = (tag, dict(attrs), [])
        self.elements.append(element)
        if tag not in self.VOID:
            self._open.append(element)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs), []))

    def handle_endtag(self, tag):
        while self._open and self._open.pop()[0] != tag:
            pass

    def handle_data(self, data):
        for element in self._open:
            element[2].append(data)

    def find(self, tag=None, **attributes):
        return [
            (attrs, "".join(text))
            for name, attrs, text in self.elements
            if (tag is None or name == tag)
            and all(attrs.get(key.replace("_", "-")) == value for key, value in attributes.items())
        ]
