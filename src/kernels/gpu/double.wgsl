// Double precision: the type, and the functions that depend on it. single.wgsl has the same for
// single precision.
//
// Only sums and products of doubles are used, because Vulkan requires no more accuracy of other
// operations than in single precision. Inverses start in single precision, with a relative error of
// 2^-20, and are refined; the proof is in src/kernels/gpu/direct.rs.

alias real = f64;
alias bits = u64;

// Inverse square root, for x from 1e-36 to 1e36, which single precision can represent.
fn inverse_root(x: real) -> real {
    let y = real(inverseSqrt(f32(x)));
    let rest = 1.0 - x * (y * y);
    return y + y * (rest * (0.5 + 0.375 * rest));
}

// Quotient, for y in the same range.
fn quotient(x: real, y: real) -> real {
    let z = real(1.0 / f32(y));
    let rest = 1.0 - y * z;
    return x * (z + z * (rest + rest * rest));
}

// Square root for error bounds, in single precision; 0 for x below 2^-126.
fn rough_root(x: real) -> real {
    return real(sqrt(f32(x)));
}

// Returns atan(t) / t for s = t^2 <= 1/9, by the series up to terms below (1/3)^32 / 33 < u / 8.
fn arctangent_series(s: real) -> real {
    var series: real = -1.0 / 31.0;
    series = series * s + 1.0 / 29.0;
    series = series * s - 1.0 / 27.0;
    series = series * s + 1.0 / 25.0;
    series = series * s - 1.0 / 23.0;
    series = series * s + 1.0 / 21.0;
    series = series * s - 1.0 / 19.0;
    series = series * s + 1.0 / 17.0;
    series = series * s - 1.0 / 15.0;
    series = series * s + 1.0 / 13.0;
    series = series * s - 1.0 / 11.0;
    series = series * s + 1.0 / 9.0;
    series = series * s - 1.0 / 7.0;
    series = series * s + 1.0 / 5.0;
    series = series * s - 1.0 / 3.0;
    return series * s + 1.0;
}
