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
