"""The same functions in plain NumPy, for checking the C++ core: slow, short and close to the equations."""
