"""Hooks of mkdocs.yml: pages are written to be read in the repository, and are built into a site.

A link out of docs/ names a file of the repository. Schemas come along with the site; what else is
named so stays as text. A page that mkdocs.yml does not name is put under "More".
"""

import re
from pathlib import Path
from posixpath import normpath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
SCHEMAS = "visref/schemas"
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(((?:\.\./)+[^)\s]*)\)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Pages that the navigation does not name are under "More"."""
    docs = Path(config.docs_dir)
    pages = {file.relative_to(docs).as_posix() for file in docs.rglob("*.md")}
    if left := sorted(pages - set(_named(config.nav))):
        config.nav.append({"More": left})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """The schemas go into the site, beside the page that lists them."""
    for file in sorted((ROOT / SCHEMAS).glob("*.json")):
        files.append(File.generated(config, f"schemas/{file.name}", abs_src_path=str(file)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links out of docs/ become text that names the file. Raises FileNotFoundError for none."""
    folder = Path(page.file.src_uri).parent.as_posix()

    def said(link: re.Match[str]) -> str:
        label, target = link[1], link[2].partition("#")[0]
        path = normpath(f"docs/{folder}/{target}")
        if not (ROOT / path).exists():
            raise FileNotFoundError(f"{page.file.src_uri} links to {target}, which is not there")
        if path.startswith(f"{SCHEMAS}/"):
            return f"[{label}]({'../' * folder.count('/')}schemas/{Path(path).name})"
        return label if path in label.strip("`/") else f"{label} (`{path}`)"

    return _LINK.sub(said, markdown)


def _named(entry: object) -> list[str]:
    """The pages that a part of the navigation names."""
    if isinstance(entry, str):
        return [entry]
    parts = entry.values() if isinstance(entry, dict) else entry
    return [page for part in parts for page in _named(part)]
