"""The bus between the processes of one host."""
