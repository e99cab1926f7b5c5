//! Numbers as a reader wants them: as many digits as mean something, powers of ten raised, a proper minus.

/// What is smaller is written as zero: the power of ten below it is no normal number.
const LEAST: f64 = 1e-300;

/// A number with so many decimals and a proper minus sign.
pub fn written(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|byte| matches!(byte, b'0' | b'.')) => digits.to_owned(),
        Some(digits) => format!("−{digits}"),
        None => text,
    }
}

/// A number to three significant digits, with a power of ten where it is very large or small.
pub fn short(value: f64) -> String {
    significant(value, 3)
}

/// A number to so many significant digits, without zeros at its end, with a power of ten where it is very
/// large or small.
pub fn significant(value: f64, digits: usize) -> String {
    if value.abs() < LEAST || !value.is_finite() {
        return written(if value.is_finite() { 0.0 } else { value }, 0);
    }
    let most = digits.max(1) as i32 - 1;
    let rounded: f64 = format!("{value:.*e}", most as usize).parse().unwrap_or(value);
    let magnitude = rounded.abs().log10().floor() as i32;
    if (-3..most.max(4) + 1).contains(&magnitude) {
        return shortened(written(rounded, (most - magnitude).max(0) as usize));
    }
    let mantissa = shortened(written(rounded / 10.0_f64.powi(magnitude), most as usize));
    format!("{mantissa}·10{}", superscript(magnitude))
}

/// Without the zeros after the point that say nothing.
fn shortened(text: String) -> String {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Numbers that belong together, such as a mean and the ends of its interval, with the decimals of which
/// `spread` leaves two that mean something, and the power of ten that all of them leave out.
pub fn alike<const N: usize>(values: [f64; N], spread: f64) -> ([String; N], i32) {
    let largest = values.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    let magnitude = |value: f64| if value > LEAST { value.log10().floor() as i32 } else { 0 };
    let exponent = match magnitude(largest) {
        magnitude if largest <= LEAST || (-3..5).contains(&magnitude) => 0,
        magnitude => magnitude.div_euclid(3) * 3,
    };
    let unit = 10.0_f64.powi(exponent);
    let last = if spread > 0.0 && spread.is_finite() { spread / unit } else { 1e-3 * largest / unit };
    let decimals = (1 - magnitude(last)).clamp(0, 12) as usize;
    (values.map(|value| written(value / unit, decimals)), exponent)
}

/// ` ·10⁹`, or nothing for no power.
pub fn power(exponent: i32) -> String {
    if exponent == 0 { String::new() } else { format!("·10{}", superscript(exponent)) }
}

/// A value with its standard deviation: `9.2262 ± 0.0003`, `(1.52 ± 0.03)·10¹¹`.
pub fn with_sd(value: f64, sd: f64) -> String {
    if sd == 0.0 {
        return significant(value, 4);
    }
    let ([value, sd], exponent) = alike([value, sd], sd);
    if exponent == 0 { format!("{value} ± {sd}") } else { format!("({value} ± {sd}){}", power(exponent)) }
}

/// Numbers of a logarithmic scale lie so far apart that they share neither digits nor a power of ten: by two decades.
fn are_decades_apart(low: f64, high: f64) -> bool {
    low > 0.0 && high > 100.0 * low
}

/// An interval: `9.2256 – 9.2267`; on a logarithmic scale also `2.5·10⁷ – 6.9·10¹⁰`.
pub fn interval(low: f64, high: f64, is_log: bool) -> String {
    if low == high {
        return significant(low, 4);
    }
    if is_log && are_decades_apart(low, high) {
        return format!("{} – {}", significant(low, 2), significant(high, 2));
    }
    let ([low, high], exponent) = alike([low, high], (high - low) / 3.3);
    if exponent == 0 { format!("{low} – {high}") } else { format!("({low} – {high}){}", power(exponent)) }
}

/// A mean with its interval, as much of it as there is room for: `9.2262 (9.2256 – 9.2267)`, or `9.2262`; see
/// [`interval`].
pub fn estimate(mean: f64, (low, high): (f64, f64), is_log: bool, fits: impl Fn(&str) -> bool) -> String {
    if low == high {
        return significant(mean, 4);
    }
    let is_apart = is_log && are_decades_apart(low, high);
    let ([mean, low, high], exponent) = if is_apart {
        ([mean, low, high].map(|value| significant(value, 2)), 0)
    } else {
        alike([mean, low, high], (high - low) / 3.3)
    };
    let power = power(exponent);
    let forms = [
        format!("{mean} ({low} – {high}){power}"),
        format!("{mean} ({low}–{high}){power}"),
        format!("{mean}{power}"),
    ];
    let [long, narrow, short] = forms;
    if fits(&long) {
        long
    } else if fits(&narrow) {
        narrow
    } else {
        short
    }
}

/// An integer in superscript digits.
pub fn superscript(number: i32) -> String {
    let raised = |character| match character {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '4' => '⁴',
        '5' => '⁵',
        '6' => '⁶',
        '7' => '⁷',
        '8' => '⁸',
        '9' => '⁹',
        _ => '⁰',
    };
    number.to_string().chars().map(raised).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_text_are_short() {
        assert_eq!(
            [short(0.0), short(0.94), short(1.3e11), short(-12.345), short(99_960.0)],
            ["0", "0.94", "1.3·10¹¹", "−12.3", "1·10⁵"]
        );
        assert_eq!([significant(0.999_96, 4), significant(123_456.0, 4)], ["1", "1.235·10⁵"]);
    }

    #[test]
    fn decades_apart_on_a_logarithmic_scale_nothing_is_zero() {
        assert_eq!(interval(2.5e7, 6.9e10, true), "2.5·10⁷ – 6.9·10¹⁰");
        assert_eq!(interval(0.02, 1.5, true), "0.02 – 1.50");
        assert_eq!(interval(0.001, 2.3, false), "0.00 – 2.30");
        let told = |fits: fn(&str) -> bool| estimate(346.0, (2e-8, 2364.0), true, fits);
        assert_eq!([told(|_| true), told(|_| false)], ["350 (2·10⁻⁸ – 2400)", "350"]);
    }

    #[test]
    fn a_value_has_the_digits_that_its_spread_leaves() {
        assert_eq!(with_sd(9.226_2, 0.000_34), "9.22620 ± 0.00034");
        assert_eq!(with_sd(1.5e11, 2.34e9), "(150.0 ± 2.3)·10⁹");
        assert_eq!(with_sd(0.3, 0.0), "0.3");
        assert_eq!(interval(-0.6, 12.0, false), "−0.6 – 12.0");
        assert_eq!(interval(0.0, 0.0, false), "0");
        assert_eq!(estimate(1.5e11, (1.46e11, 1.54e11), true, |_| true), "150.0 (146.0 – 154.0)·10⁹");
        assert_eq!(estimate(0.3, (0.1, 0.5), false, |_| false), "0.30");
    }
}
