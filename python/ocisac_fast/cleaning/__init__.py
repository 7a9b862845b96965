"""The picture without the light's bands: `bands` is what users call. It finds the light of the rows (`row_light`, from
`tone_light` and `chip_light`), has every pixel's share of it estimated, and puts the result back into samples
(`stored`).
"""
