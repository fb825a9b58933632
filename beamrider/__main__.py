"""`python -m beamrider …`: as `beamrider …`, see `beamrider.command`."""

from beamrider.command import main

if __name__ == "__main__":
    main()
