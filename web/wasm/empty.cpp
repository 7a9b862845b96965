// Emscripten links an executable of at least one source; all that it exports is of the library.
