//! A quasi-Newton minimiser within bounds.

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub struct Stop {
    /// Iterations at most.
    pub iterations: usize,
    /// A decrease that is not worth another iteration.
    pub decrease: f64,
    /// A value above which no minimum is of use: a search that is further from it than [`FAR`] steps of the last size is
    /// given up.
    pub useful: f64,
}

/// How many more steps of the last size a search may need to what is of use.
const FAR: f64 = 20.0;

/// Steps before that is asked: the first ones say little of how far there is to go.
const FIRST_STEPS: usize = 3;

/// Where a search ended.
#[derive(Clone, Debug)]
pub struct Minimum {
    /// The place, shape (variables,).
    pub x: Vec<f64>,
    /// The value there.
    pub value: f64,
    /// The inverse of the second derivatives as the search has found them, shape (variables, variables); none where no
    /// step has shown them.
    pub inverse_hessian: Option<Vec<Vec<f64>>>,
}

/// Largest change of a variable in one iteration.
const LONGEST_STEP: f64 = 2.0;

/// Minimise a function within bounds, from `start`; it may be undefined in places. Returns where the search ended, if the
/// function is defined at `start`.
///
/// * `function` — gives its value and what computes its gradient, which is asked for where a step is taken.
/// * `inverse_hessian` — what is known of it, shape (variables, variables).
///
/// BFGS on the variables that no bound holds, with backtracking along the path bent at the bounds
/// (Bertsekas 1982, SIAM J. Control Optim. 20:221).
pub fn minimise<G: FnOnce() -> Vec<f64>>(
    mut function: impl FnMut(&[f64]) -> Option<(f64, G)>,
    start: &[f64],
    inverse_hessian: Option<Vec<Vec<f64>>>,
    bounds: &[(f64, f64)],
    stop: Stop,
) -> Option<Minimum> {
    let d = start.len();
    let mut x: Vec<f64> = start.iter().zip(bounds).map(|(x, b)| x.clamp(b.0, b.1)).collect();
    let (mut value, gradient) = function(&x)?;
    let mut gradient = gradient();
    let mut is_fresh = inverse_hessian.is_none();
    let mut inverse_hessian = inverse_hessian.unwrap_or_else(|| scaled_identity(d, 1.0));
    for iteration in 0..stop.iterations {
        let free: Vec<bool> = (0..d)
            .map(|i| {
                let (low, high) = bounds[i];
                !(x[i] <= low && gradient[i] > 0.0 || x[i] >= high && gradient[i] < 0.0)
            })
            .collect();
        let direction: Vec<f64> = (0..d)
            .map(|i| {
                let sum: f64 = (0..d).filter(|&j| free[j]).map(|j| inverse_hessian[i][j] * gradient[j]).sum();
                if free[i] { -sum } else { 0.0 }
            })
            .collect();
        let longest = direction.iter().fold(0.0_f64, |longest, step| longest.max(step.abs()));
        if longest == 0.0 {
            break;
        }
        let mut share = (if is_fresh { 0.5 } else { LONGEST_STEP } / longest).min(1.0);
        let mut found = None;
        for _ in 0..20 {
            let next: Vec<f64> =
                (0..d).map(|i| (x[i] + share * direction[i]).clamp(bounds[i].0, bounds[i].1)).collect();
            let slope: f64 = (0..d).map(|i| gradient[i] * (next[i] - x[i])).sum();
            let trial = function(&next);
            if let Some((new_value, new_gradient)) = trial {
                if new_value <= value + 1e-4 * slope {
                    found = Some((next, new_value, new_gradient()));
                    break;
                }
                // The minimum of the parabola through both values with the slope here.
                let curvature = new_value - value - slope;
                let ratio = if curvature > 0.0 { -0.5 * slope / curvature } else { 0.5 };
                share *= ratio.clamp(0.1, 0.5);
            } else {
                share *= 0.25;
            }
        }
        let Some((next, new_value, new_gradient)) = found else {
            if is_fresh {
                break;
            }
            inverse_hessian = scaled_identity(d, 1.0);
            is_fresh = true;
            continue;
        };
        let s: Vec<f64> = (0..d).map(|i| next[i] - x[i]).collect();
        let y: Vec<f64> = (0..d).map(|i| new_gradient[i] - gradient[i]).collect();
        let decrease = value - new_value;
        (x, value, gradient) = (next, new_value, new_gradient);
        let is_far = iteration >= FIRST_STEPS && value - stop.useful > FAR * decrease;
        if (decrease < stop.decrease || is_far) && !is_fresh {
            break;
        }
        is_fresh = !update(&mut inverse_hessian, &s, &y, is_fresh) && is_fresh;
    }
    Some(Minimum { x, value, inverse_hessian: (!is_fresh).then_some(inverse_hessian) })
}

fn scaled_identity(d: usize, scale: f64) -> Vec<Vec<f64>> {
    (0..d).map(|i| (0..d).map(|j| if i == j { scale } else { 0.0 }).collect()).collect()
}

/// Take a step `s` that changed the gradient by `y` into the inverse Hessian, if the curvature along
/// it is positive.
fn update(inverse: &mut Vec<Vec<f64>>, s: &[f64], y: &[f64], is_fresh: bool) -> bool {
    let d = s.len();
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (curvature, square) = (product(s, y), product(y, y));
    if curvature.is_nan() || curvature <= 1e-10 * (square * product(s, s)).sqrt() {
        return false;
    }
    if is_fresh {
        *inverse = scaled_identity(d, curvature / square);
    }
    let change: Vec<f64> = inverse.iter().map(|row| product(row, y)).collect();
    let along = (1.0 + product(y, &change) / curvature) / curvature;
    for i in 0..d {
        for j in 0..d {
            inverse[i][j] += along * s[i] * s[j] - (change[i] * s[j] + s[i] * change[j]) / curvature;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    const STOP: Stop = Stop { iterations: 200, decrease: 1e-14, useful: f64::INFINITY };

    fn rosenbrock(x: &[f64]) -> Option<(f64, impl FnOnce() -> Vec<f64> + use<>)> {
        let (a, b, height) = (1.0 - x[0], x[1] - x[0] * x[0], x[0]);
        Some((a * a + 100.0 * b * b, move || vec![-2.0 * a - 400.0 * height * b, 200.0 * b]))
    }

    #[test]
    fn the_valley_of_rosenbrock_is_followed_to_its_end() {
        let Minimum { x, .. } = minimise(rosenbrock, &[-1.2, 1.0], None, &[(-5.0, 5.0); 2], STOP).unwrap();
        assert!((x[0] - 1.0).abs() < 1e-5 && (x[1] - 1.0).abs() < 1e-5, "{x:?}");
    }

    #[test]
    fn a_minimum_on_a_bound_is_found() {
        // On x₀ = ½ the minimum over x₁ is at x₀².
        let Minimum { x, .. } =
            minimise(rosenbrock, &[-1.2, 1.0], None, &[(-5.0, 0.5), (-5.0, 5.0)], STOP).unwrap();
        assert!((x[0] - 0.5).abs() < 1e-12 && (x[1] - 0.25).abs() < 1e-5, "{x:?}");
    }

    /// Where a search ends, and how often the function is asked.
    fn counted<G: FnOnce() -> Vec<f64>>(
        function: impl Fn(&[f64]) -> Option<(f64, G)>,
        start: &[f64],
        inverse_hessian: Option<Vec<Vec<f64>>>,
        stop: Stop,
    ) -> (Minimum, usize) {
        let mut asked = 0;
        let count = |x: &[f64]| {
            asked += 1;
            function(x)
        };
        (minimise(count, start, inverse_hessian, &[(-5.0, 5.0); 2], stop).unwrap(), asked)
    }

    #[test]
    fn a_search_that_knows_how_the_function_bends_asks_it_less_and_ends_at_the_same_place() {
        let bowl = |x: &[f64]| {
            let x = [x[0] - 3.0, x[1] + 2.0];
            Some((x[0] * x[0] + 50.0 * x[1] * x[1] + x[0] * x[1], move || {
                vec![2.0 * x[0] + x[1], 100.0 * x[1] + x[0]]
            }))
        };
        let search = |inverse_hessian| {
            let (found, asked) = counted(bowl, &[2.5, -1.0], inverse_hessian, STOP);
            assert!((found.x[0] - 3.0).abs() < 1e-5 && (found.x[1] + 2.0).abs() < 1e-5, "{found:?}");
            (found.inverse_hessian, asked)
        };
        let (bend, first) = search(None);
        let (_, second) = search(bend);
        assert!(second < first && second <= 4, "{second} {first}");
    }

    #[test]
    fn a_search_is_given_up_where_what_is_of_use_is_out_of_reach() {
        let until = |useful: f64| counted(rosenbrock, &[-1.2, 1.0], None, Stop { useful, ..STOP });
        let (_, all) = until(f64::INFINITY);
        let (found, some) = until(-1e3);
        assert!(found.value > 1.0 && some < all / 4, "{found:?} {some} {all}");
        let (found, _) = until(4.5);
        assert!(found.value < 1e-10, "{found:?}");
    }

    #[test]
    fn places_where_the_function_is_undefined_are_stepped_back_from() {
        let function = |x: &[f64]| {
            let x = x[0];
            (x > 0.0).then(|| (x - x.ln(), move || vec![1.0 - 1.0 / x]))
        };
        let Minimum { x, .. } = minimise(function, &[0.01], None, &[(-10.0, 10.0)], STOP).unwrap();
        assert!((x[0] - 1.0).abs() < 1e-5, "{x:?}");
    }
}
