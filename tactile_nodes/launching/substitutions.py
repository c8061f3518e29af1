"""The values of substitutions, by name: what ``$(var …)``, ``$(env …)``, ``$(eval …)`` and the others mean."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from typing import TYPE_CHECKING

from tactile_nodes.launching import expressions, packages, values
from tactile_nodes.launching.document import suggestion
from tactile_nodes.launching.template import SubstitutionError

if TYPE_CHECKING:
    from tactile_nodes.launching.context import Context


def _var(context: Context, name: str, default: str | None = None) -> str:
    if name in context.configurations:
        return context.configurations[name]
    if default is None:
        hint = suggestion(name, context.configurations)
        raise SubstitutionError(f"the launch configuration '{name}' does not exist{hint}")
    return default


def _env(context: Context, name: str, default: str | None = None) -> str:
    value = context.environment.get(name, default)
    if value is None:
        raise SubstitutionError(f"the environment variable '{name}' does not exist and no default is given")
    return value


def _find_pkg_share(context: Context, package: str) -> str:
    return str(packages.share_of(package, context.environment))


def _find_pkg_prefix(context: Context, package: str) -> str:
    return str(packages.prefix_of(package, context.environment))


def _exec_in_pkg(context: Context, executable: str, package: str) -> str:
    command = packages.command_of(package, executable, context.environment)
    if len(command) > 1:
        raise SubstitutionError(f"'{executable}' of {package} has no program file here; install the package")
    return command[0]


def _find_exec(context: Context, name: str) -> str:
    found = shutil.which(name, path=context.environment.get('PATH'))
    if found is None:
        raise SubstitutionError(f"executable '{name}' not found on the PATH")
    return found


def _dirname(context: Context) -> str:
    return str(context.file.parent)


def _filename(context: Context) -> str:
    return str(context.file)


def _eval(_: Context, expression: str, modules: str = 'math') -> str:
    if other := {module.strip() for module in modules.split(',')} - {'math'}:
        raise SubstitutionError(f"only the module 'math' is allowed, not {', '.join(sorted(other))}")
    return expressions.evaluate(expression)


def _and(_: Context, left: str, right: str) -> str:
    return _text(values.boolean(left) & values.boolean(right))


def _or(_: Context, left: str, right: str) -> str:
    return _text(values.boolean(left) | values.boolean(right))


def _not(_: Context, operand: str) -> str:
    return _text(not values.boolean(operand))


def _text(value: bool) -> str:
    return 'true' if value else 'false'


FUNCTIONS: dict[str, Callable[..., str]] = {
    'and': _and,
    'dirname': _dirname,
    'env': _env,
    'eval': _eval,
    'exec-in-pkg': _exec_in_pkg,
    'filename': _filename,
    'find-exec': _find_exec,
    'find-pkg-prefix': _find_pkg_prefix,
    'find-pkg-share': _find_pkg_share,
    'not': _not,
    'or': _or,
    'var': _var,
}
