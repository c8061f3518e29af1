"""Chromium without a window, for the tests that look at a page.

Skipped where there is no Chromium (Debian: apt-get install chromium) or no playwright (part of the extra ``dev``).
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

playwright = pytest.importorskip('playwright.sync_api', reason='playwright is not installed: pip install .[dev]')
expect = playwright.expect
CHROMIUM = next((found for name in ('chromium', 'chromium-browser') if (found := shutil.which(name))), None)
IN_CHROMIUM = [
    pytest.mark.browser,
    pytest.mark.skipif(CHROMIUM is None, reason='there is no Chromium on this machine: apt-get install chromium'),
]
SIZE = {'width': 1280, 'height': 720}
PATIENCE_MS = 60_000
expect.set_options(timeout=PATIENCE_MS)


@contextmanager
def started() -> Iterator[Any]:
    """The browser, in which pages are opened: as tabs of one user, since one more of those takes it a second."""
    sandbox = [] if os.geteuid() else ['--no-sandbox']  # Chromium has none for root
    with playwright.sync_playwright() as driver:
        made = driver.chromium.launch(executable_path=CHROMIUM, args=['--disable-gpu', *sandbox], timeout=PATIENCE_MS)
        browser = made.new_context(viewport=SIZE, color_scheme='dark')
        browser.set_default_timeout(PATIENCE_MS)
        browser.unused = []
        yield browser
        made.close()


@contextmanager
def opened(browser: Any, url: str) -> Iterator[Any]:
    """A page, and what went wrong on it: its `faults`. Afterwards its tab is there for the next one."""
    made = browser.unused.pop() if browser.unused else _tab(browser)
    made.faults = []
    made.set_viewport_size(SIZE)
    made.goto(url)
    yield made
    if not made.is_closed():
        made.goto('about:blank')
        browser.unused.append(made)


def _tab(browser: Any) -> Any:
    made = browser.new_page()
    made.on('pageerror', lambda error: made.faults.append(str(error)))
    made.on('console', lambda message: made.faults.append(message.text) if message.type == 'error' else None)
    return made
