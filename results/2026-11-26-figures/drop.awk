# A closed curve with one sharp corner, along z: the surface of figure-4, as OBJ.
BEGIN {
  for (i = 0; i < 200; i++) {
    t = 6.2831853 * i / 200; x = cos(t); y = sin(t) * sin(t / 2) ^ 1.5
    for (z = 0; z < 2; z++) print "v", 0.92 * x - 0.39 * y, 0.39 * x + 0.92 * y, z / 4
  }
  for (i = 0; i < 200; i++) { a = 2 * i + 1; b = 2 * ((i + 1) % 200) + 1; print "f", a, b, b + 1, a + 1 }
}
