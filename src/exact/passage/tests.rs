use super::polynomial::Interval;
use super::*;
use crate::kernels::oracle;

struct Random(u64);
impl Random {
    fn next(&mut self, n: u64) -> i64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) % n) as i64
    }
}
type Polygon = Vec<[i64; 3]>;

fn polygon(r: &mut Random, n: usize, range: u64) -> Polygon {
    (0..n).map(|_| [0; 3].map(|_: i64| r.next(range))).collect()
}
fn total(i: [&Polygon; 2], j: [&Polygon; 2], scale: f64, n: &mut [u64; 4]) -> i64 {
    let edge =
        |p: &Polygon, k: usize| [p[k], p[(k + 1) % p.len()]].map(|p| p.map(|x| x as f64 * scale));
    let mut sum = 0;
    for k in 0..i[0].len() {
        for l in 0..j[0].len() {
            let [before, after] = [0, 1].map(|f| [edge(i[f], k), edge(j[f], l)]);
            let d = passages(&before, &after, Ties::Translate, &mut |p| {
                sum += i64::from(p.sign)
            });
            n[d as usize] += 1;
        }
    }
    sum
}

#[test]
fn quick() {
    let mut r = Random(88172645463325252);
    let mut n = [0; 4];
    let (mut done, mut changed) = (0, 0);
    let start = std::time::Instant::now();
    while done < 3000 {
        let range = [2, 3, 4, 6, 20, 1000][r.next(6) as usize];
        let (ni, nj) = (3 + r.next(4) as usize, 3 + r.next(4) as usize);
        let [i0, i1] = [0, 1].map(|_| polygon(&mut r, ni, range));
        let [j0, j1] = [0, 1].map(|_| polygon(&mut r, nj, range));
        let (Some(l0), Some(l1)) = (
            oracle::linking_number(&i0, &j0),
            oracle::linking_number(&i1, &j1),
        ) else {
            continue;
        };
        done += 1;
        changed += u64::from(l0 != l1);
        let t = total([&i0, &i1], [&j0, &j1], 1.0, &mut n);
        assert_eq!(t, l1 - l0, "{i0:?} {i1:?} {j0:?} {j1:?}");
    }
    println!("{changed} changed, {n:?}, {:?}", start.elapsed());
    let _ = Interval::step();
}

#[test]
fn speed() {
    let mut r = Random(0x1234_5678_9abc_def1);
    let mut unit = || r.next(1 << 30) as f64 / f64::from(1 << 29) - 1.0;
    let mut vector = |size: f64| [0; 3].map(|_| size * unit());
    let add = |a: Point, b: Point| [0, 1, 2].map(|x| a[x] + b[x]);
    let mut scenes: Vec<(&str, Vec<(Edges, Edges)>)> = Vec::new();
    let n = 2_000;
    // A pair of edges of length about 1 whose inner points meet up to `gap`, moving by `motion`.
    let mut make = |gap: f64, motion: f64| {
        let (p, q, m) = (vector(1.0), vector(1.0), vector(10.0));
        let [s, u] = vector(0.4).map(|x| 0.5 + x)[..2] else { unreachable!() };
        let off = add(m, vector(gap));
        let before = [
            [add(m, p.map(|x| -s * x)), add(m, p.map(|x| (1.0 - s) * x))],
            [add(off, q.map(|x| -u * x)), add(off, q.map(|x| (1.0 - u) * x))],
        ];
        let after = before.map(|e| e.map(|p| add(p, vector(motion))));
        (before, after)
    };
    scenes.push(("far", (0..n).map(|_| make(4.0, 0.1)).filter(|(b, a)| filter::apart(b, a)).collect()));
    let quiet = |(b, a): &(Edges, Edges)| {
        let mut count = 0;
        exactly(b, a, Ties::Translate, &mut |_| count += 1);
        count == 0 && !filter::apart(b, a)
    };
    scenes.push(("near, small motion", (0..n).map(|_| make(0.3, 0.01)).filter(quiet).collect()));
    scenes.push(("near, motion 0.1", (0..n).map(|_| make(0.3, 0.1)).filter(quiet).collect()));
    scenes.push(("near, motion 1", (0..n).map(|_| make(1.0, 1.0)).filter(quiet).collect()));
    scenes.push(("crossing", (0..n).map(|_| make(0.1, 0.3)).filter(|m| !quiet(m) && !filter::apart(&m.0, &m.1)).collect()));
    scenes.push(("crossing fast", (0..n).map(|_| make(1.0, 3.0)).filter(|m| !quiet(m) && !filter::apart(&m.0, &m.1)).collect()));
    for (name, pairs) in &scenes {
        let mut best = [f64::INFINITY; 2];
        let mut n = [0; 4];
        let mut events = 0;
        for _ in 0..1 {
            (n, events) = ([0; 4], 0);
            let start = std::time::Instant::now();
            for (before, after) in pairs {
                n[passages(before, after, Ties::Translate, &mut |_| events += 1) as usize] += 1;
            }
            best[0] = best[0].min(start.elapsed().as_nanos() as f64 / pairs.len() as f64);
        }
        let few = &pairs[..pairs.len().min(1000)];
        let start = std::time::Instant::now();
        for (before, after) in few {
            exactly(before, after, Ties::Translate, &mut |_| events += 1);
        }
        best[1] = start.elapsed().as_nanos() as f64 / few.len() as f64;
        println!("{name}: {} pairs {best:.1?} ns a pair; {n:?}, {events}", pairs.len());
    }
}
