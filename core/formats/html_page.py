"""Reports as self-contained HTML pages."""

from __future__ import annotations

from html import escape

_STYLE = (
    "body{font:15px system-ui,sans-serif;max-width:1240px;margin:2em auto;padding:0 1em;color:#222}"
    "table{border-collapse:collapse;margin:1em 0}"
    "td,th{padding:.25em .8em;text-align:right;border-bottom:1px solid #ddd}"
    "th:first-child,td:first-child,.shots td,.shots th{text-align:left}img{max-width:100%}"
    ".warning{background:#fff3d0;padding:.6em 1em}"
)


def html_page(title: str, body: str) -> str:
    """Return a page with a title (plain text) and a body (HTML)."""
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style>'
    return f'<!doctype html><html lang="en">{head}<h1>{escape(title)}</h1>{body}</html>\n'
