"""What `make site` does beside MkDocs: pages from the top of the checkout, links that leave docs/, pages of results.

The same Markdown is read on a code host, where a link may lead to any file of the checkout.
"""

import re
from pathlib import Path, PurePosixPath
from typing import Any

from mkdocs.plugins import get_plugin_logger
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from tactile_nodes import __version__

LOG = get_plugin_logger('links')
ROOT = Path(__file__).parents[1]
FROM_TOP = {'CHANGELOG.md': 'changelog.md', 'CONTRIBUTING.md': 'contributing.md', 'SECURITY.md': 'security.md'}
"""Pages that a code host expects at the top of a checkout, and where they are in the site."""
LINK = re.compile(r'(?<=\]\()(?!\w+:|#)([^)#\s]+)')


def on_files(files: Files, config: Any) -> Files:
    """Add the pages from the top, and every page of results that is there to the navigation."""
    for name, page in FROM_TOP.items():
        files.append(File.generated(config, page, content=(ROOT / name).read_text(encoding='utf-8')))
    results = _entry(config['nav'], 'Results')
    found = {file.src_uri for file in files.documentation_pages() if file.src_uri.startswith('results/')}
    results += [{name[len('results/') : -len('.md')]: name} for name in sorted(found - {'results/README.md'})]
    return files


def on_page_markdown(markdown: str, page: Page, config: Any, **_: Any) -> str:
    """Point links that leave docs/ to the page that the site made of the file, or to the code host."""
    source = next((name for name, made in FROM_TOP.items() if made == page.file.src_uri), f'docs/{page.file.src_uri}')
    here = PurePosixPath(source).parent

    def leads(match: re.Match[str]) -> str:
        path = (ROOT / here / match[1]).resolve().relative_to(ROOT)
        if path.as_posix() in FROM_TOP:
            target = FROM_TOP[path.as_posix()]
        elif path.parts[0] == 'docs':
            target = path.relative_to('docs').as_posix()
        elif (ROOT / path).exists():
            return f'{config["extra"]["repository"]}/blob/v{__version__}/{path.as_posix()}'
        else:
            LOG.warning(f'{source} points to {match[1]}, which is not there')
            return match[1]
        return '../' * (page.file.src_uri.count('/')) + target

    return LINK.sub(leads, markdown)


def _entry(nav: list[Any], title: str) -> list[Any]:
    """The list below a title, wherever in the navigation that is."""
    for item in nav:
        for name, below in item.items() if isinstance(item, dict) else ():
            if name == title:
                return below
            if isinstance(below, list) and (found := _entry(below, title)):
                return found
    return []
