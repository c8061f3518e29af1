"""The sentence on the page when no force comes, in Chromium: it names what is most wrong."""

from __future__ import annotations

from urllib.parse import quote

from browsing import IN_CHROMIUM, started

from tactile_nodes.web.server import STATIC_FILES

pytestmark = IN_CHROMIUM
SENTENCES = {
    ('warning', 'error'): 'No data for 5 s. /flow: it is flow',
    ('error', 'error'): 'No data for 5 s. /camera: it is camera',
    ('ok', 'warning'): 'No data for 5 s. /flow: it is flow',
    ('ok', 'ok'): 'No data for 5 s.',
}


def test_an_error_is_named_before_a_warning() -> None:
    module = f'data:text/javascript,{quote(STATIC_FILES["js/status.js"].read_text())}'
    call = 'async ([module, fields]) => (await import(module)).statusOf(fields, 5, false, { open: true })'
    with started() as browser:
        page = browser.new_page()
        for levels, sentence in SENTENCES.items():
            health = [
                {'node': f'/{name}', 'level': level, 'text': f'it is {name}', 'silent_s': None}
                for name, level in zip(('camera', 'flow'), levels, strict=True)
            ]
            found = page.evaluate(call, [module, {'force': {}, 'slow': {'health': health}}])
            assert found == ['nodata', 'NO DATA', sentence]
