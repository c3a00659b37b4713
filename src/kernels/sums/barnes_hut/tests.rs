use super::*;
use crate::kernels::tests::polygons::{LONG_RIBBONS, SCENES, check, hopf, polylines, scene};
use crate::scenes::Scene;

fn options(order: Order, accept: Accept) -> Options {
    Options { order, accept }
}

/// Returns all combinations of options.
fn ways() -> Vec<Options> {
    let accepts = [
        Accept::Beta(1.3),
        Accept::Beta(3.0),
        Accept::Estimated {
            beta: 2.0,
            target: 0.2,
            most: 10.0,
        },
        Accept::Bound(0.4),
        Accept::Bound(0.01),
    ];
    let orders = [Order::Dipole, Order::Quadrupole];
    let each = |accept| orders.map(|order| options(order, accept));
    accepts.into_iter().flat_map(each).collect()
}

#[test]
fn bounds_cover_the_error_on_scenes() {
    SCENES.into_iter().for_each(check_scene);
}

#[test]
#[ignore = "takes minutes"]
fn bounds_cover_the_error_on_long_ribbons() {
    LONG_RIBBONS.into_iter().for_each(check_scene);
}

fn check_scene(text: &str) {
    let (set, lambda) = scene(text);
    for way in ways() {
        let found = BarnesHut::new(&set, way).linking_number((0, 1));
        check(found, lambda, &format_args!("{text} {way:?}"));
        let back = BarnesHut::new(&set, way).linking_number((1, 0));
        check(back, lambda, &format_args!("{text} {way:?}, swapped"));
        if let Accept::Bound(budget) = way.accept {
            assert!(found.bound <= budget, "{text} {way:?}: {found:?}");
            assert_eq!(found.integer(), Some(lambda));
        }
    }
}

#[test]
fn a_large_linking_number_is_never_rounded_to_a_wrong_one() {
    // The published method returns -999 for a ribbon like this one.
    let (set, lambda) = scene("ribbon:segments=200000,lambda=1000");
    for beta in [1.3, 2.0, 2.5] {
        let way = options(Order::Quadrupole, Accept::Beta(beta));
        let found = BarnesHut::new(&set, way).linking_number((0, 1));
        check(found, lambda, &beta);
        assert_eq!(found.integer(), None);
    }
    let found = BarnesHut::new(&set, Options::default()).linking_number((0, 1));
    assert_eq!(found.integer(), Some(lambda));
}

#[test]
fn the_error_decreases_with_beta_as_published() {
    let (set, lambda) = scene("ribbon:segments=100000,lambda=300");
    let error = |order, beta: f64| {
        let way = options(order, Accept::Beta(beta));
        let found = BarnesHut::new(&set, way).linking_number((0, 1));
        ((found.value - lambda as f64).abs(), found.bound)
    };
    for (order, power) in [(Order::Dipole, 3.0), (Order::Quadrupole, 4.0)] {
        // The mean over a range, because single errors have either sign.
        let [coarse, fine] = [[1.8, 2.0, 2.2], [5.4, 6.0, 6.6]].map(|betas| {
            let found = betas.map(|beta| error(order, beta));
            found.iter().map(|f| f.0).sum::<f64>() / 3.0
        });
        let slope = (coarse / fine).ln() / 3f64.ln();
        assert!((slope - power).abs() < 1.5, "{order:?}: {slope}");
        assert!(error(order, 6.0).1 < error(order, 2.0).1 / 10.0);
    }
}

#[test]
fn scaling_does_not_change_the_result() {
    for exponent in [-1074, -1070, -1022, -500, -50, 0, 50, 500, 1020] {
        let half = exponent / 2;
        let scale = 2f64.powi(half) * 2f64.powi(exponent - half);
        let [a, b] = hopf(scale, 0.0);
        let found =
            BarnesHut::new(&polylines(&[&a, &b]), Options::default()).linking_number((0, 1));
        assert_eq!(
            found.integer().map(i64::abs),
            Some(1),
            "{exponent}: {found:?}"
        );
    }
    // Far from the origin, and beside curves that are much larger.
    let [a, b] = hopf(2f64.powi(-40), 1.0);
    let [far, _] = hopf(1e9, 0.0);
    let set = polylines(&[&a, &b, &far]);
    let found = BarnesHut::new(&set, Options::default());
    assert_eq!(
        found.linking_number((0, 1)).integer().map(i64::abs),
        Some(1)
    );
}

#[test]
fn repeated_vertices_and_point_curves_are_no_contact() {
    let [a, b] = hopf(1.0, 0.0);
    let mut repeated = b.clone();
    repeated.extend([b[3]; 20]);
    let point = vec![[0.5, 0.25, 0.0]; 9];
    let set = polylines(&[&a, &repeated, &point]);
    let sums = BarnesHut::new(&set, Options::default());
    assert_eq!(sums.linking_number((0, 1)).integer().map(i64::abs), Some(1));
    assert_eq!(sums.linking_number((0, 2)).integer(), Some(0));
}

/// Measures the models and scenes named in `MODELS`, on one thread:
/// `MODELS="a.bcc ribbon:lambda=10"`.
#[test]
#[ignore]
fn measure() {
    let names = std::env::var("MODELS").unwrap_or("ribbon:lambda=10".into());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    pool.unwrap()
        .install(|| names.split_whitespace().for_each(measure_one));
}

/// Returns the CPU time of this thread, from Linux.
fn thread_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split_whitespace().next().and_then(|t| t.parse().ok());
    nanoseconds.unwrap_or(f64::NAN) * 1e-9
}

fn measure_one(name: &str) {
    use crate::pairs::{LinkSearch, Trees};
    let path = std::path::Path::new(name);
    let set = if path.exists() {
        let model = crate::formats::read(path).unwrap();
        crate::homotopic_polylines(&model).unwrap().curves
    } else {
        name.parse::<Scene>().unwrap().build().unwrap().curves
    };
    let mut boxes = Trees::default();
    boxes.refit(&set);
    let pairs = LinkSearch::default().find(boxes.roots()).to_vec();
    println!("{name}: {} segments, {} pairs", set.segments(), pairs.len());
    println!(
        "accept, order: ms of trees, of sums | node pairs | \
         largest distance from an integer, largest bound | undecided"
    );
    let mut ways = Vec::new();
    for beta in [2.0, 3.0, 4.0, 6.0, 8.0] {
        ways.push(options(Order::Dipole, Accept::Beta(beta)));
        ways.push(options(Order::Quadrupole, Accept::Beta(beta)));
    }
    let (beta, target, most) = (2.0, 0.2, 10.0);
    let published = Accept::Estimated { beta, target, most };
    ways.push(options(Order::Quadrupole, published));
    ways.push(options(Order::Quadrupole, Accept::Bound(0.4)));
    ways.push(Options::default());
    for way in ways {
        let runs: [_; 3] = std::array::from_fn(|_| {
            let start = thread_seconds();
            let kernel = BarnesHut::new(&set, way);
            let built = thread_seconds();
            let sums: Vec<Sum> = pairs.iter().filter_map(|&p| kernel.sum(p)).collect();
            (thread_seconds() - built, built - start, sums)
        });
        let mut times = runs.each_ref().map(|r| (r.0, r.1));
        times.sort_by(|a, b| a.0.total_cmp(&b.0));
        let [_, (summing, building), _] = times;
        let found: Vec<Estimate> = runs[0].2.iter().map(Sum::estimate).collect();
        let most = |of: &dyn Fn(&Estimate) -> f64| found.iter().map(of).fold(0.0, f64::max);
        let count = |of: &dyn Fn(&Sum) -> u64| runs[0].2.iter().map(of).sum::<u64>();
        println!(
            "{:?} {:?}: {:.1} {:.1} | expanded {} leaf pairs {} visited {} | {:.1e} {:.1e} | {}",
            way.accept,
            way.order,
            building * 1e3,
            summing * 1e3,
            count(&|s| s.expanded),
            count(&|s| s.summed),
            count(&|s| s.visited),
            most(&|e| (e.value - e.value.round()).abs()),
            most(&|e| e.bound),
            found.iter().filter(|e| e.integer().is_none()).count(),
        );
    }
}
