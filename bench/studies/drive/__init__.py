"""The exposure controller in a closed loop: a simulated drive past a modulated light."""
