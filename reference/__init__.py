"""What is generated from the code: parts of the documentation, and what message classes look like to a type checker."""
