//! Codes of a diagram as text: planar diagram (PD), Gauss and Dowker-Thistlethwaite (DT).

use super::Diagram;
use std::collections::VecDeque;

impl Diagram {
    /// Returns the PD code: for each crossing its four arcs counterclockwise, beginning with the
    /// incoming lower one. The arcs are numbered from 1 along the components, in their order.
    ///
    /// This is the convention of KnotTheory and of SnapPy's `Link`. Components without crossings
    /// have no arcs.
    pub fn pd_code(&self) -> Vec<[u32; 4]> {
        // Incoming and outgoing arc of each passage.
        let mut arcs = vec![[0, 0]; 2 * self.signs.len()];
        let mut first = 1;
        for passages in &self.components {
            let count = passages.len() as u32;
            for (k, &passage) in (0..).zip(passages) {
                arcs[passage as usize] = [first + k, first + (k + 1) % count];
            }
            first += count;
        }
        let crossings = arcs.as_chunks::<2>().0.iter().zip(&self.signs);
        let code = crossings.map(|([under, over], sign)| match sign {
            // Seen from the lower strand, the upper one passes from left to right: from the fourth
            // arc to the second one.
            1 => [under[0], over[1], under[1], over[0]],
            _ => [under[0], over[0], under[1], over[1]],
        });
        code.collect()
    }

    /// Returns the PD code as text of KnotTheory, `PD[X[1, 5, 2, 4], ...]`, with a `Loop` for each
    /// component without crossings.
    pub fn pd_text(&self) -> String {
        let crossings = self.pd_code().into_iter();
        let crossings = crossings.map(|[a, b, c, d]| format!("X[{a}, {b}, {c}, {d}]"));
        let loops = self.components.iter().filter(|c| c.is_empty());
        let first = 2 * self.crossings() + 1;
        let loops = (first..).zip(loops).map(|(arc, _)| format!("Loop[{arc}]"));
        format!("PD[{}]", joined(crossings.chain(loops)))
    }

    /// Returns the Gauss code: for each component the numbers of its crossings, from 1 in the order
    /// in which they are first met, negative if the component passes below.
    pub fn gauss_code(&self) -> Vec<Vec<i32>> {
        let number = |&passage: &u32| match passage % 2 {
            0 => -(passage as i32 / 2) - 1,
            _ => passage as i32 / 2 + 1,
        };
        let numbers = |passages: &Vec<u32>| passages.iter().map(number).collect();
        self.components.iter().map(numbers).collect()
    }

    /// Returns the Gauss code as text of KnotTheory, `GaussCode[-1, 2, -3, 1, -2, 3]`, with braces
    /// around each component if there are several.
    pub fn gauss_text(&self) -> String {
        let single = self.components.len() == 1;
        let [open, close] = if single { ["", ""] } else { ["{", "}"] };
        let components = self.gauss_code().into_iter();
        let components = components.map(|c| format!("{open}{}{close}", joined(c.iter())));
        format!("GaussCode[{}]", joined(components))
    }

    /// Returns the DT code. Each crossing is passed once with an odd and once with an even number;
    /// the code lists the even numbers in the order of the odd ones. The first number is positive.
    /// Another number is positive if its passage is on the same level (over or under) as the first
    /// one. Components without crossings have empty lists.
    ///
    /// The code does not tell a diagram from its mirror image.
    ///
    /// # Proof: there is such a numbering
    ///
    /// Two closed curves in general position in the plane cross an even number of times. So each
    /// component has an even number of passages, and a curve from a crossing back to it, along a
    /// component or two, crosses the rest evenly. The starts of the components are shifted, by one
    /// passage at most, so that one crossing of two components gets different parities; then all
    /// of them do.
    pub fn dt_code(&self) -> Vec<Vec<i32>> {
        let positions = self.positions();
        let mut shifts: Vec<Option<u32>> = vec![None; self.components.len()];
        let mut front = VecDeque::new();
        for start in 0..shifts.len() {
            if shifts[start].is_none() {
                shifts[start] = Some(0);
                front.push_back((start, 0));
            }
            while let Some((component, shift)) = front.pop_front() {
                for (k, &passage) in (0..).zip(&self.components[component]) {
                    let (other, l) = positions[passage as usize ^ 1];
                    let other = other as usize;
                    if shifts[other].is_none() {
                        let shift = (k + l + shift + 1) % 2;
                        shifts[other] = Some(shift);
                        front.push_back((other, shift));
                    }
                }
            }
        }
        let mut numbers = vec![0; 2 * self.signs.len()];
        let mut orders = Vec::new();
        let mut first = 1;
        for (passages, shift) in self.components.iter().zip(&shifts) {
            let mut order = passages.clone();
            order.rotate_left(shift.unwrap_or(0) as usize % passages.len().max(1));
            for (number, &passage) in (first..).zip(&order) {
                numbers[passage as usize] = number;
            }
            first += order.len() as i32;
            orders.push(order);
        }
        let evens = |order: &Vec<u32>| order.iter().step_by(2).map(|p| p ^ 1).collect();
        let evens: Vec<Vec<u32>> = orders.iter().map(evens).collect();
        let first = evens.iter().flatten().next();
        let level = first.map_or(0, |passage| passage % 2);
        let number = |passage: &u32| match passage % 2 == level {
            true => numbers[*passage as usize],
            false => -numbers[*passage as usize],
        };
        let numbers = |order: &Vec<u32>| order.iter().map(number).collect();
        evens.iter().map(numbers).collect()
    }

    /// Returns the DT code as text of SnapPy, `DT: [(4,6,2)]`.
    pub fn dt_text(&self) -> String {
        let mut components = self.dt_code();
        components.retain(|c| !c.is_empty());
        let components = components.iter().map(|c| match &c[..] {
            // A tuple of Python.
            [one] => format!("({one},)"),
            _ => format!("({})", joined(c.iter())),
        });
        format!("DT: [{}]", joined(components))
    }
}

fn joined<T: ToString>(items: impl Iterator<Item = T>) -> String {
    let items: Vec<String> = items.map(|item| item.to_string()).collect();
    items.join(", ")
}
