"""`python -m swarmdata` is the command `swarmdata`."""

from swarmdata.cli.main import main

if __name__ == "__main__":
    main()
