"""Vision-based touch sensing: from images of a camera under a soft gel to the normal force on its surface in newtons.

`docs/architecture.md` describes the parts of the package. The contracts in `pyproject.toml` fix which part may import
which.
"""

__version__ = '0.2.0'
