"""Links between vehicles against distance, ambient light, speed and number of lamps; figures that others published."""
