"""The command line: a module for each command, which parses and prints. What a command does
lives below, and is there for Python too."""
