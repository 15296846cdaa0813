"""``python -m fusion.cli``: the command line without its installed script."""

from fusion.cli.start import main

if __name__ == "__main__":
    main()
