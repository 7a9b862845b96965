"""Speed and accuracy of the gain methods: scenes, methods, measurements and drawing of ``make chart``."""
