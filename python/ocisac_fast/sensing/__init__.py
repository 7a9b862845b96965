"""The sensing side: what moving textures and modulated lights show in a picture.

Pictures are searched (`search`) for regions, a region is fitted (`fit`), told apart (`kind`, `motion`) and measured
(`gain`, `contrast`); `region` and `picture` are what users call.
"""
