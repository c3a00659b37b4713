// Single precision: the type, and what is not computed alike in both. double.wgsl has the same in double precision.

alias real = f32;
alias bits = u32;

fn inverse_root(x: real) -> real {
    return inverseSqrt(x);
}

fn quotient(x: real, y: real) -> real {
    return x / y;
}

// A root for bounds, whose last places do not matter.
fn rough_root(x: real) -> real {
    return sqrt(x);
}

// atan(t) / t with s = t^2 <= 1/9: the series, but for terms below (1/3)^14 / 15 < u / 8.
fn arctangent_series(s: real) -> real {
    var series: real = 1.0 / 13.0;
    series = series * s - 1.0 / 11.0;
    series = series * s + 1.0 / 9.0;
    series = series * s - 1.0 / 7.0;
    series = series * s + 1.0 / 5.0;
    series = series * s - 1.0 / 3.0;
    return series * s + 1.0;
}
