"""Vision-based touch sensing: a camera under a soft gel in, the normal force on its surface in newtons out.

The map of the package is `docs/architecture.md`; the order in which its parts may import each other is held
by the contracts in `pyproject.toml`.
"""

__version__ = '0.2.0'
