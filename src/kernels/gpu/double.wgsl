// Double precision: the type, and what is not computed alike in both. single.wgsl has the same in single precision.
//
// Of doubles, only sums and products are used: Vulkan promises no more of the rest than of singles. Inverses begin in
// single precision, off by 2^-20 of themselves, and are refined; src/kernels/gpu/direct.rs has the proof.

alias real = f64;
alias bits = u64;

// From 1e-36 to 1e36, which single precision has room for.
fn inverse_root(x: real) -> real {
    let y = real(inverseSqrt(f32(x)));
    let rest = 1.0 - x * (y * y);
    return y + y * (rest * (0.5 + 0.375 * rest));
}

// For such a y.
fn quotient(x: real, y: real) -> real {
    let z = real(1.0 / f32(y));
    let rest = 1.0 - y * z;
    return x * (z + z * (rest + rest * rest));
}

// A root for bounds, whose last places do not matter; 0 below 2^-126.
fn rough_root(x: real) -> real {
    return real(sqrt(f32(x)));
}

// atan(t) / t with s = t^2 <= 1/9: the series, but for terms below (1/3)^32 / 33 < u / 8.
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
