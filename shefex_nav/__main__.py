"""`python -m shefex_nav`: the commands, where the folder of scripts is not on the path."""

from shefex_nav.commands.main import main

if __name__ == "__main__":
    main()
