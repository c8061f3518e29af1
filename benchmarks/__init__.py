"""What is measured, and how: every contender in one run, interleaved, on the machine that the report names."""
