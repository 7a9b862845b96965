"""The exposure: chosen once for two tones (`choice`), weighed (`fronts`), kept right frame by frame (`controller`), and
tried on a drive past a traffic light (`drive`).
"""
