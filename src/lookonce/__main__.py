"""``python -m lookonce``, where the command ``lookonce`` is not on the path."""

from lookonce.cli.app import main

if __name__ == "__main__":
    main()
