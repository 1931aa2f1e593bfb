// How different two pictures are.

/**
 * @param {ArrayLike<number>} a Red, green, blue, alpha.
 * @param {ArrayLike<number>} b
 */
export function compare(a, b) {
  let [differ, most, sum] = [0, 0, 0];
  const pixels = a.length / 4;
  for (let k = 0; k < pixels; k++) {
    let off = 0;
    for (let c = 0; c < 3; c++) off = Math.max(off, Math.abs(a[4 * k + c] - b[4 * k + c]));
    if (off > 2) differ++;
    most = Math.max(most, off);
    sum += off;
  }
  return { share: differ / pixels, most, mean: sum / pixels };
}
