"""``tactile completion``: print the shell code that completes ``tactile``."""

from __future__ import annotations

import argparse

DESCRIPTION = 'Print shell code that completes commands, flags and the names of running nodes, topics and services.'
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
    parser.add_argument('shell', choices=['bash', 'zsh', 'fish'], help='your shell')


def run(arguments: argparse.Namespace) -> int:
    from argcomplete.shell_integration import shellcode

    print(shellcode(['tactile'], shell=arguments.shell))
    return 0
