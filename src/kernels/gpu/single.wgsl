// Single precision: the type, and the functions that depend on it. double.wgsl has the same for
// double precision.

alias real = f32;
alias bits = u32;

fn inverse_root(x: real) -> real {
    return inverseSqrt(x);
}

fn quotient(x: real, y: real) -> real {
    return x / y;
}

// Square root for error bounds.
fn rough_root(x: real) -> real {
    return sqrt(x);
}

// Returns atan(t) / t for s = t^2 <= 1/9, by the series up to terms below (1/3)^14 / 15 < u / 8.
fn arctangent_series(s: real) -> real {
    var series: real = 1.0 / 13.0;
    series = series * s - 1.0 / 11.0;
    series = series * s + 1.0 / 9.0;
    series = series * s - 1.0 / 7.0;
    series = series * s + 1.0 / 5.0;
    series = series * s - 1.0 / 3.0;
    return series * s + 1.0;
}
