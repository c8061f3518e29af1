"""The configuration that an ATI Net F/T box reports in ``netftapi2.xml``: counts per unit, units, rate.

No value is assumed: some boxes have other counts than a million per unit, or ``Nm`` instead of ``N-m``, and newer
sensors (Axia) write ``commrdtrate`` instead of ``comrdtrate``. Only the five fields that convert counts to newtons are
required.
"""

from __future__ import annotations

import html
import http.client
import re
from collections.abc import Mapping
from dataclasses import dataclass

from tactile_nodes.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError

PAGE = '/netftapi2.xml'
HTTP_TIMEOUT_S = 2.0
LARGEST_PAGE = 65_536
INTERNAL_RATE_HZ = 7000.0  # of a box that does not report its `runrate`

LBF_N, KGF_N, INCH_M = 4.4482216152605, 9.80665, 0.0254
FORCE_N = {
    'n': 1.0, 'kn': 1e3, 'lbf': LBF_N, 'lb': LBF_N, 'klbf': 1e3 * LBF_N, 'klb': 1e3 * LBF_N,
    'kgf': KGF_N, 'kg': KGF_N, 'gf': KGF_N / 1e3, 'g': KGF_N / 1e3,
    '1': LBF_N, '2': 1.0, '3': 1e3 * LBF_N, '4': 1e3, '5': KGF_N, '6': KGF_N / 1e3,
}  # fmt: skip
TORQUE_NM = {
    'nm': 1.0, 'nmm': 1e-3, 'knm': 1e3, 'kgcm': KGF_N / 100, 'kgfcm': KGF_N / 100,
    'lbfin': LBF_N * INCH_M, 'lbin': LBF_N * INCH_M, 'inlbf': LBF_N * INCH_M, 'inlb': LBF_N * INCH_M,
    'lbfft': LBF_N * 12 * INCH_M, 'lbft': LBF_N * 12 * INCH_M,
    'ftlbf': LBF_N * 12 * INCH_M, 'ftlb': LBF_N * 12 * INCH_M,
    '1': LBF_N * INCH_M, '2': LBF_N * 12 * INCH_M, '3': 1.0, '4': 1e-3, '5': KGF_N / 100, '6': 1e3,
}  # fmt: skip
"""Keys: the unit's string without separators, or the box's number for it."""


@dataclass(frozen=True)
class BoxConfig:
    """The active configuration of a box.

    Attributes:
        units_per_count: N (three times) and N·m (three times) per count.
        rate_hz: RDT output rate as reported; 0 if it is not.
        internal_rate_hz: rate at which `ft_sequence` counts.
        enabled: whether it streams at all.
        axia: whether it is of the kind that writes ``commrdtrate``.
        fields: everything that it reported, for the record.
    """

    units_per_count: tuple[float, ...]
    rate_hz: float
    internal_rate_hz: float
    enabled: bool
    axia: bool
    fields: Mapping[str, str]


def read_config(host: str, port: int) -> BoxConfig:
    """Read the configuration of a box.

    Raises:
        DeviceNotFoundError: no response from that address.
        DeviceTimeoutError: the response is too slow.
        DeviceError: the response is not a usable configuration.
    """
    return parse_config(fetch(host, port, PAGE), host)


def parse_config(page: bytes, host: str) -> BoxConfig:
    """As `read_config`, from a fetched page."""
    text = page.decode('utf-8', 'replace')
    if re.search(r'<netft\b', text, re.IGNORECASE) is None:
        raise DeviceError(f'the page {PAGE} of {host} is not that of a Net F/T box; check the address')
    fields = {name.lower(): html.unescape(value).strip() for name, value in _FIELD.findall(text)}
    force = _unit(fields, 'scfgfu', FORCE_N, host) / _counts(fields, 'cfgcpf', host)
    torque = _unit(fields, 'scfgtu', TORQUE_NM, host) / _counts(fields, 'cfgcpt', host)
    axia = 'commrdtrate' in fields
    rate = fields.get('commrdtrate' if axia else 'comrdtrate', '0')
    enabled = fields.get('comrdte', 'Enabled').lower() not in {'disabled', '0'}
    internal = _number(fields.get('runrate', '')) or INTERNAL_RATE_HZ
    return BoxConfig((force,) * 3 + (torque,) * 3, _number(rate), internal, enabled, axia, fields)


_FIELD = re.compile(r'<(\w+)(?:\s[^>]*)?>([^<]*)</\1\s*>')


def _unit(fields: Mapping[str, str], name: str, table: Mapping[str, float], host: str) -> float:
    written = fields.get(name, '')
    factor = table.get(written if written.isdigit() else re.sub(r'[^a-z]', '', written.lower()))
    if factor is None:
        units = ', '.join(unit for unit in table if not unit.isdigit())
        raise DeviceError(
            f'the box at {host} measures in {written!r} ({name}), which is not one of {units}; '
            'choose another unit on its Configurations page'
        )
    return factor


def _counts(fields: Mapping[str, str], name: str, host: str) -> float:
    counts = _number(fields.get(name, ''))
    if counts <= 0:
        raise DeviceError(
            f'the box at {host} reports {fields.get(name)!r} counts per unit ({name}), which cannot be '
            'used; check its active configuration and calibration'
        )
    return counts


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return 0.0
    return value if 0 < value < float('inf') else 0.0


def set_rate(host: str, port: int, rate_hz: float, axia: bool) -> None:
    """Change the output rate of a box permanently.

    Raises:
        DeviceError: it refuses; and as `read_config`.
    """
    name = 'commrdtrate' if axia else 'comrdtrate'
    fetch(host, port, f'/comm.cgi?{name}={round(rate_hz)}')


def fetch(host: str, port: int, target: str) -> bytes:
    """A page of the box."""
    connection = http.client.HTTPConnection(host, port, timeout=HTTP_TIMEOUT_S)
    try:
        connection.request('GET', target)
        response = connection.getresponse()
        body = response.read(LARGEST_PAGE)
    except TimeoutError as error:
        raise DeviceTimeoutError(
            f'the box at {host} did not respond within {HTTP_TIMEOUT_S:g} s; check its address, power and cable'
        ) from error
    except (OSError, http.client.HTTPException) as error:
        reason = getattr(error, 'strerror', None) or str(error) or type(error).__name__
        raise DeviceNotFoundError(
            f'cannot reach the box at {host}, port {port} ({reason}); check its address, power and cable'
        ) from error
    finally:
        connection.close()
    if response.status != http.client.OK:
        raise DeviceError(
            f'{host} responded {response.status} {response.reason} for {target.partition("?")[0]}, a page of every Net '
            'F/T box; perhaps another device, such as a router, has this address: check force_torque.source'
        )
    return body
