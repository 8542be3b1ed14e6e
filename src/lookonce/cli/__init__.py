"""The command line: flags in, one call, exit code out."""
