// Matrices of `SIDE` by `SIDE` 16-bit floats, which a subgroup of `SUBGROUP` invocations multiplies at once.
// choose: SMALL_MATRICES common/matrices_16 common/matrices_8
// constant: SMALL_MATRICES 0
// constant: SUBGROUP 32
