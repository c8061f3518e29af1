"""Snapshots as data for the page: millimetres, newtons, milliseconds, words. NaN means unknown."""

from __future__ import annotations

import math
from typing import Any

from tactile_nodes.messages import stamp_ns
from tactile_nodes.viewing.measures import NS_PER_S
from tactile_nodes.viewing.net import net_of
from tactile_nodes.viewing.reasons import sentences
from tactile_nodes.viewing.state import SILENT_AFTER_S, NodeHealth, Snapshot
from tactile_nodes.viewing.surface import Surface

_STATUSES = ('ok', 'degraded', 'invalid')
_LEVELS = ('ok', 'warning', 'error', 'stale')
_CALIBRATION = ('valid', 'ageing', 'invalid', 'unknown', 'not calibrated')
_MM = 1000.0


def force(message: Any) -> dict[str, Any] | None:
    """A ForceDistribution without its bins."""
    if message is None:
        return None
    return {
        'stamp_s': stamp_ns(message.header.stamp) / NS_PER_S,
        'status': _STATUSES[min(message.status, 2)],
        'reasons': sentences(message.reasons),
        'total_n': message.total,
        'sigma_n': message.total_sigma or None,
        'peak_n': message.peak,
        'in_contact': bool(message.in_contact),
        'contacts': [_contact(each) for each in message.contacts],
        'net': _net(message),
        'rows': message.rows,
        'cols': message.cols,
        'bin_mm': [message.bin_width * _MM, message.bin_height * _MM],
        'origin_mm': [message.origin.x * _MM, message.origin.y * _MM],
    }


def surface(found: Surface | None) -> dict[str, Any] | None:
    """The grid of a ForceField; its cells are a section of the packet."""
    if found is None:
        return None
    rows, cols = found.pressure_kpa.shape
    return {'rows': rows, 'cols': cols, 'cell_mm': found.cell_mm, 'origin_mm': found.origin_mm}


def truth(message: Any) -> dict[str, Any] | None:
    """The true force, if a simulator publishes it."""
    return None if message is None else {'total_n': message.total}


def motion(message: Any) -> dict[str, Any] | None:
    """The grid of a FlowFeatures; its arrows are a section of the packet."""
    if message is None:
        return None
    return {
        'rows': message.rows,
        'cols': message.cols,
        'width_px': message.image_width,
        'height_px': message.image_height,
    }


def calibration(message: Any) -> dict[str, str] | None:
    """Validity of the calibration, in the drift monitor's words; None without drift monitor."""
    if message is None:
        return None
    return {'level': _CALIBRATION[min(message.level, 4)], 'text': message.text}


def slowly(shot: Snapshot) -> dict[str, Any]:
    """Values for reading, which change a few times per second at most."""
    return {
        'namespace': shot.namespace,
        'rates': {
            'arriving_hz': shot.arrivals_hz,
            'lost': shot.lost,
            'skipped': shot.skipped,
            'malformed': shot.malformed,
        },
        'latency_ms': [[stage, 1e3 * found.p50, 1e3 * found.p99] for stage, found in shot.latencies.items()],
        'health': [_health(each) for each in shot.health],
        'logs': list(shot.logs),
        'provenance': _provenance(shot.force),
    }


def hand(message: Any) -> dict[str, Any] | None:
    """A HandWrench: net force [N] with standard deviations, moment [N mm], and the contact that slips first."""
    if message is None:
        return None
    covariance = message.wrench_covariance
    pull, turn = message.wrench.force, message.wrench.torque
    first = message.margins[0] if message.margins else None
    has_covariance = covariance[0] >= 0
    return {
        'stamp_s': stamp_ns(message.header.stamp) / NS_PER_S,
        'frame': message.header.frame_id,
        'force_n': [pull.x, pull.y, pull.z],
        'force_sigma_n': [math.sqrt(max(0.0, covariance[7 * axis])) for axis in range(3)] if has_covariance else None,
        'moment_n_mm': [turn.x * _MM, turn.y * _MM, turn.z * _MM],
        'missing': list(message.missing),
        'slips_first': {'sensor': first.sensor, 'margin': first.margin, 'sigma': first.margin_sigma} if first else None,
    }


def _contact(each: Any) -> dict[str, float]:
    return {
        'x_mm': each.position.x * _MM,
        'y_mm': each.position.y * _MM,
        'sigma_mm': each.position_sigma * _MM,
        'force_n': each.force,
        'sigma_n': each.force_sigma,
        'shear_n': [each.shear_x, each.shear_y],
        'torsion_n_mm': each.torsion * _MM,
    }


def _net(message: Any) -> dict[str, Any]:
    found = net_of(message)
    return {
        'explanation': found.explanation,
        'shear_n': found.shear_n,
        'shear_sigma_n': found.shear_sigma_n or None,
        'direction_deg': math.degrees(found.direction_rad),
        'torsion_n_mm': found.torsion_n_mm,
        'torsion_sigma_n_mm': found.torsion_sigma_n_mm or None,
    }


def _health(each: NodeHealth) -> dict[str, Any]:
    silent_s = each.age_s if each.age_s > SILENT_AFTER_S else None
    return {'node': each.node, 'level': _LEVELS[min(each.level, 3)], 'text': each.text, 'silent_s': silent_s}


def _provenance(message: Any) -> dict[str, str]:
    if message is None:
        return {}
    names = ('model', 'model_id', 'calibration_id', 'gel', 'reference_id', 'tare_id')
    return {name: getattr(message.provenance, name) for name in names}
