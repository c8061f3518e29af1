"""ROS 2's YAML launch format without ROS 2: the same file runs here and under ``ros2 launch``.

From a file to processes, one module per step::

    document     YAML with line marks, keys read by type       template      text with $(substitutions), parsed
    reading      actions, every key checked                    substitutions what they mean (expressions: $(eval …))
    actions, process_actions, node_parameters                  what each action does, in a context
    interpreter  performs them                                 packages      where executables are found
    service      the run: supervisor (one process's life), processes (the child), output, agenda, orphans

``docs/launching.md`` says what ROS 2 does in each case, and where this differs on purpose.
"""
