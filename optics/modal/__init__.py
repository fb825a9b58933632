"""Tables of gratings by the Fourier modal method."""
