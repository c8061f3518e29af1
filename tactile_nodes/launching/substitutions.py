"""The values of substitutions, by name: what ``$(var …)``, ``$(env …)``, ``$(eval …)`` and the others mean."""

from __future__ import annotations

import os
import random
import re
import shlex
import shutil
import socket
import subprocess
from collections.abc import Callable
from typing import TYPE_CHECKING

from tactile_nodes.launching import expressions, packages, values
from tactile_nodes.launching.document import suggestion
from tactile_nodes.launching.template import SubstitutionError

if TYPE_CHECKING:
    from tactile_nodes.launching.context import Context

_COMMAND_TIMEOUT_S = 30
# What `command` does with error output -> where that goes; a warning goes to the launcher's own error output.
_STDERR = {
    'fail': subprocess.PIPE,
    'ignore': subprocess.DEVNULL,
    'warn': None,
    'capture': subprocess.STDOUT,
}


def _var(context: Context, name: str, default: str | None = None) -> str:
    if name in context.configurations:
        return context.configurations[name]
    if default is None:
        known = suggestion(name, context.configurations)
        raise SubstitutionError(f"the launch configuration '{name}' does not exist{known}")
    return default


def _env(context: Context, name: str, default: str | None = None) -> str:
    value = context.environment.get(name, default)
    if value is None:
        raise SubstitutionError(f"the environment variable '{name}' does not exist, and no default is given")
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
        raise SubstitutionError(f"only the module 'math' may be used, not {', '.join(sorted(other))}")
    return expressions.evaluate(expression)


def _command(context: Context, command: str, on_stderr: str = 'fail') -> str:
    if not context.allow_commands:
        raise SubstitutionError('running commands while a launch file is read needs --allow-commands')
    if on_stderr not in _STDERR:
        raise SubstitutionError(f"error output is to 'fail', 'ignore', 'warn' or 'capture', got '{on_stderr}'")
    done = _run(command, context.environment, _STDERR[on_stderr])
    if done.returncode != 0:
        text = (done.stderr or done.stdout).strip()
        raise SubstitutionError(f'the command ended with status {done.returncode}: {text}')
    if on_stderr == 'fail' and done.stderr:
        raise SubstitutionError(f'the command wrote to its error output: {done.stderr.strip()}')
    return done.stdout


def _run(command: str, environment: dict[str, str], stderr: int | None) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(
            shlex.split(command),
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            errors='replace',
            timeout=_COMMAND_TIMEOUT_S,
            check=False,
        )
    except (ValueError, IndexError) as error:
        raise SubstitutionError(f'{command!r} is no command: {error}') from error
    except subprocess.TimeoutExpired as error:
        raise SubstitutionError(f'the command did not end within {_COMMAND_TIMEOUT_S} s') from error


def _anon(context: Context, name: str) -> str:
    key = f'anon{name}'
    if key not in context.configurations:
        host = re.sub(r'[-.:]', '_', socket.gethostname())
        number = random.SystemRandom().randrange(2**31)
        context.configurations[key] = f'{name}_{host}_{os.getpid()}_{number}'
    return context.configurations[key]


def _log_dir(context: Context) -> str:
    return str(context.log_folder)


def _and(_: Context, left: str, right: str) -> str:
    return _text(values.boolean(left) & values.boolean(right))


def _or(_: Context, left: str, right: str) -> str:
    return _text(values.boolean(left) | values.boolean(right))


def _not(_: Context, operand: str) -> str:
    return _text(not values.boolean(operand))


def _text(value: bool) -> str:
    return 'true' if value else 'false'


def _param(context: Context, name: str) -> str:
    for parameter in context.scope.parameters:
        if isinstance(parameter, tuple) and parameter[0] == name:
            return parameter[1]
    raise SubstitutionError(f"parameter '{name}' was not set by set_parameter")


FUNCTIONS: dict[str, Callable[..., str]] = {
    'and': _and,
    'anon': _anon,
    'command': _command,
    'dirname': _dirname,
    'env': _env,
    'eval': _eval,
    'exec-in-pkg': _exec_in_pkg,
    'filename': _filename,
    'find-exec': _find_exec,
    'find-pkg-prefix': _find_pkg_prefix,
    'find-pkg-share': _find_pkg_share,
    'log_dir': _log_dir,
    'not': _not,
    'or': _or,
    'param': _param,
    'var': _var,
}
