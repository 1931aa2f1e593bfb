//! At most 255 colours that stand for any number of them, by median cut.

use std::collections::HashMap;

/// Colours of a `.vox` file: index 0 is none.
pub(super) const MOST: usize = 255;

/// Colours, and which of them stands for each one of an octree.
pub(super) struct Palette {
    pub(super) colors: Vec<[u8; 3]>,
    of: HashMap<[u8; 3], u8>,
}

impl Palette {
    /// If there are few enough colours, each stands for itself.
    pub(super) fn new(all: impl Iterator<Item = [u8; 3]>) -> Self {
        let mut counts: HashMap<[u8; 3], u64> = HashMap::new();
        all.for_each(|color| *counts.entry(color).or_default() += 1);
        let mut counts: Vec<([u8; 3], u64)> = counts.into_iter().collect();
        counts.sort_unstable();
        let mut boxes = if counts.is_empty() { Vec::new() } else { vec![counts] };
        while boxes.len() < MOST {
            // The box that is worst shown by one colour: the widest, weighed by how often it occurs.
            let worst = |colors: &Vec<([u8; 3], u64)>| {
                let (_, width) = widest(colors);
                (width as f64) * (colors.iter().map(|(_, n)| *n as f64).sum::<f64>()).sqrt()
            };
            let found = (0..boxes.len()).max_by(|&a, &b| worst(&boxes[a]).total_cmp(&worst(&boxes[b])));
            let Some(index) = found.filter(|&index| boxes[index].len() > 1) else { break };
            let mut low = boxes.swap_remove(index);
            let (axis, _) = widest(&low);
            low.sort_unstable_by_key(|&(color, _)| (color[axis], color));
            let half = low.iter().map(|(_, n)| n).sum::<u64>() / 2;
            let mut below = 0;
            let middle = low.iter().position(|(_, n)| {
                below += n;
                below > half
            });
            let high = low.split_off(middle.unwrap_or(0).clamp(1, low.len() - 1));
            boxes.extend([low, high]);
        }
        let (mut colors, mut of) = (Vec::new(), HashMap::new());
        boxes.sort_unstable();
        for (index, members) in boxes.iter().enumerate() {
            let all = members.iter().map(|(_, n)| n).sum::<u64>().max(1);
            let mean = |axis: usize| {
                let sum: u64 = members.iter().map(|&(color, n)| u64::from(color[axis]) * n).sum();
                ((sum + all / 2) / all) as u8
            };
            colors.push([mean(0), mean(1), mean(2)]);
            of.extend(members.iter().map(|&(color, _)| (color, index as u8)));
        }
        Self { colors, of }
    }

    /// The index of the colour that stands for this one, which was in the list.
    pub(super) fn index(&self, color: [u8; 3]) -> u8 {
        self.of.get(&color).copied().unwrap_or(0)
    }
}

/// The channel in which colours differ most, and by how much.
fn widest(colors: &[([u8; 3], u64)]) -> (usize, u8) {
    let width = |axis: usize| {
        let values = || colors.iter().map(|(color, _)| color[axis]);
        values().max().unwrap_or(0) - values().min().unwrap_or(0)
    };
    let axis = (0..3).max_by_key(|&axis| width(axis)).unwrap_or(0);
    (axis, width(axis))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_colours_stay_and_many_are_near() {
        let few: Vec<[u8; 3]> = (0..255).map(|i| [i, 255 - i, i / 2]).collect();
        let palette = Palette::new(few.iter().copied());
        assert!(few.iter().all(|&color| palette.colors[usize::from(palette.index(color))] == color));
        let many: Vec<[u8; 3]> =
            (0..20_000u32).map(|i| [(i % 251) as u8, (i / 97) as u8, (i % 13 * 19) as u8]).collect();
        let palette = Palette::new(many.iter().copied());
        assert_eq!(palette.colors.len(), MOST);
        let off = |&color: &[u8; 3]| {
            let stands = palette.colors[usize::from(palette.index(color))];
            (0..3).map(|k| stands[k].abs_diff(color[k])).max().unwrap()
        };
        assert!(many.iter().all(|color| off(color) < 64));
        assert_eq!(Palette::new(std::iter::empty()).colors.len(), 0);
    }
}
