"""``tactile completion``: print what makes the shell complete ``tactile``."""

from __future__ import annotations

import argparse

DESCRIPTION = 'Print what to source so that the shell completes verbs, flags, and the names of what is running.'
EPILOG = """\
for this shell alone:
  eval "$(tactile completion bash)"
  eval "$(tactile completion zsh)"
  tactile completion fish | source

for every new shell:
  echo 'eval "$(tactile completion bash)"' >> ~/.bashrc
  echo 'eval "$(tactile completion zsh)"'  >> ~/.zshrc          (after compinit)
  tactile completion fish > ~/.config/fish/completions/tactile.fish
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the verb."""
    parser.add_argument('shell', choices=['bash', 'zsh', 'fish'], help='your shell')


def run(arguments: argparse.Namespace) -> int:
    """Print it."""
    from argcomplete.shell_integration import shellcode

    print(shellcode(['tactile'], shell=arguments.shell))
    return 0
