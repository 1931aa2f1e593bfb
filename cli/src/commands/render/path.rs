//! Moving cameras: a path through cameras of a file, and a turn around the objects.

use std::f64::consts::TAU;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use esvo_core::Camera;
use glam::{DQuat, DVec3};

use crate::files::name_file;
use crate::view::Key;

/// Largest file of cameras, in bytes.
const LARGEST: u64 = 1 << 20;

/// A path that goes through cameras at their times.
#[derive(Debug)]
pub(crate) struct CameraPath {
    /// Ascending by time.
    keys: Vec<(f64, Key)>,
}

impl CameraPath {
    /// Reads a file of cameras: see [`parse`](Self::parse). `fov_degrees` is the field of view where a camera has none.
    pub(crate) fn read(path: &Path, fov_degrees: f64) -> Result<Self, String> {
        let file = File::open(path).map_err(|error| name_file(path, error))?;
        let mut bytes = Vec::new();
        file.take(LARGEST + 1).read_to_end(&mut bytes).map_err(|error| name_file(path, error))?;
        let expected = "expected lines of cameras: ex,ey,ez,fx,fy,fz";
        if bytes.len() as u64 > LARGEST {
            return Err(name_file(path, format!("is larger than 1 MiB; {expected}")));
        }
        let text = String::from_utf8(bytes).map_err(|_| name_file(path, format!("is not a text file; {expected}")))?;
        Self::parse(&text, &path.display().to_string(), fov_degrees)
    }

    /// One camera a line, as in `--camera`; `seconds: ` before each or before none. Empty lines and lines that start with `#` say
    /// nothing. Without times the cameras follow each other in equal ones.
    fn parse(text: &str, name: &str, fov_degrees: f64) -> Result<Self, String> {
        let mut keys: Vec<(f64, Key)> = Vec::new();
        let mut timed = None;
        for (number, line) in (1..).zip(text.lines()) {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let place = format!("{name}: line {number}");
            let (time, numbers) = match line.split_once(':') {
                Some((time, numbers)) => (Some(time.trim()), numbers),
                None => (None, line),
            };
            if *timed.get_or_insert(time.is_some()) != time.is_some() {
                return Err(format!("{place}: give every camera a time, or none"));
            }
            let time = match time {
                None => keys.len() as f64,
                Some(text) => text
                    .parse::<f64>()
                    .ok()
                    .filter(|time| time.is_finite())
                    .ok_or_else(|| format!("{place}: {text} is no time; expected seconds: ex,ey,ez,fx,fy,fz"))?,
            };
            if let Some((before, _)) = keys.last().filter(|(before, _)| *before >= time) {
                return Err(format!("{place}: the time {time} is not after {before}, that of the camera before"));
            }
            let mut key = Key::parse(numbers, &place)?;
            key.forward = key.forward.normalize_or_zero();
            key.fov_degrees.get_or_insert(fov_degrees);
            // Within a degree of the opposite, the way to turn would be a matter of rounding.
            if keys.last().is_some_and(|(_, before)| before.forward.dot(key.forward) < -0.9998) {
                return Err(format!("{place}: the direction is opposite to that before; put a camera between them"));
            }
            keys.push((time, key));
        }
        if keys.len() < 2 {
            let lines = "give two or more lines ex,ey,ez,fx,fy,fz";
            return Err(format!(
                "{name}: has {} for a path; {lines}",
                if keys.is_empty() { "no camera" } else { "one camera" }
            ));
        }
        Ok(Self { keys })
    }

    /// Cameras at equal times, from the first of the path to its last.
    ///
    /// # Errors
    /// Between two cameras the direction turns by so much that it has no middle.
    pub(crate) fn frames(&self, name: &str, frames: u32) -> Result<Vec<Key>, String> {
        let (first, last) = (self.keys[0].0, self.keys[self.keys.len() - 1].0);
        let step = (last - first) / f64::from(frames.max(2) - 1);
        (0..frames).map(|frame| self.at(name, first + step * f64::from(frame))).collect()
    }

    /// The camera at a time: Catmull-Rom splines through eyes, directions and fields of view.
    fn at(&self, name: &str, time: f64) -> Result<Key, String> {
        let next = self.keys.partition_point(|(at, _)| *at <= time).clamp(1, self.keys.len() - 1);
        let ((start, a), (end, b)) = (&self.keys[next - 1], &self.keys[next]);
        let part = ((time - start) / (end - start)).clamp(0.0, 1.0);
        let along = |value: &dyn Fn(&Key) -> DVec3| {
            let [from, to] = [next - 1, next].map(|key| self.tangent(key, value) * (end - start));
            hermite([value(a), value(b)], [from, to], part)
        };
        let forward = along(&|key| key.forward);
        if forward.length() < 1e-3 {
            return Err(format!(
                "{name}: the directions of two cameras, at {start} and {end}, are opposite; put a camera between them"
            ));
        }
        let degrees = |key: &Key| key.fov_degrees.unwrap_or_default();
        let (narrow, wide) = (degrees(a).min(degrees(b)), degrees(a).max(degrees(b)));
        let fov_degrees = along(&|key| DVec3::splat(degrees(key))).x.clamp(narrow, wide);
        Ok(Key { eye: along(&|key| key.eye), forward: forward.normalize(), fov_degrees: Some(fov_degrees) })
    }

    /// The change of a value with time at a camera: that of the parabola through it and its neighbours; at the ends, of the line
    /// to the neighbour.
    fn tangent(&self, key: usize, value: &dyn Fn(&Key) -> DVec3) -> DVec3 {
        let slope = |from: usize| {
            let ((start, a), (end, b)) = (&self.keys[from], &self.keys[from + 1]);
            ((value(b) - value(a)) / (end - start), end - start)
        };
        if key == 0 {
            return slope(0).0;
        }
        let (before, earlier) = slope(key - 1);
        if key == self.keys.len() - 1 {
            return before;
        }
        let (after, later) = slope(key);
        (before * later + after * earlier) / (earlier + later)
    }
}

/// The cubic with these values and tangents at 0 and 1.
fn hermite([a, b]: [DVec3; 2], [from, to]: [DVec3; 2], at: f64) -> DVec3 {
    let (square, cube) = (at * at, at * at * at);
    a * (2.0 * cube - 3.0 * square + 1.0)
        + from * (cube - 2.0 * square + at)
        + b * (3.0 * square - 2.0 * cube)
        + to * (cube - square)
}

/// A camera that goes once around the axis through `centre` that points up, against the clock as seen from above. The planes stay.
pub(crate) fn turn(camera: &Camera, centre: DVec3, frames: u32) -> Vec<Camera> {
    let up = DVec3::from(camera.up).normalize_or_zero();
    let turned = |frame: u32| {
        let turn = DQuat::from_axis_angle(up, TAU * f64::from(frame) / f64::from(frames));
        let eye = centre + turn * (DVec3::from(camera.eye) - centre);
        let forward = turn * DVec3::from(camera.forward);
        Camera { eye: eye.to_array(), forward: forward.to_array(), ..*camera }
    };
    (0..frames).map(turned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<CameraPath, String> {
        CameraPath::parse(text, "p.txt", 60.0)
    }

    #[test]
    fn paths_go_through_their_cameras_at_their_times() {
        let path = parse("# a path\n 0: 0,0,0, 0,0,-2\n\n1: 1,0,0,1,0,0,30\n4: 1,5,0,0,1,0\n").unwrap();
        let frames = path.frames("p.txt", 5).unwrap();
        let near = |a: DVec3, b: [f64; 3]| a.distance(b.into()) < 1e-12;
        assert!(near(frames[0].eye, [0.0; 3]) && near(frames[0].forward, [0.0, 0.0, -1.0]));
        assert!(near(frames[1].eye, [1.0, 0.0, 0.0]) && near(frames[1].forward, [1.0, 0.0, 0.0]));
        assert!(near(frames[4].eye, [1.0, 5.0, 0.0]) && near(frames[4].forward, [0.0, 1.0, 0.0]));
        let degrees: Vec<f64> = frames.iter().map(|key| key.fov_degrees.unwrap()).collect();
        assert_eq!((degrees[0], degrees[1], degrees[4]), (60.0, 30.0, 60.0));
        assert!(degrees.iter().all(|d| (30.0..=60.0).contains(d)));
        assert!(frames.iter().all(|key| (key.forward.length() - 1.0).abs() < 1e-12));
        assert_eq!(path.frames("p.txt", 1).unwrap()[0].eye, DVec3::ZERO);
    }

    /// Steps become small with their times: a jump at a camera would not.
    #[test]
    fn paths_are_smooth() {
        let path = parse("0,0,0,0,0,-1\n1,0,0,1,0,0\n1,5,0,0,1,0\n-3,5,2,0,1,1,90").unwrap();
        let frames = path.frames("p.txt", 3001).unwrap();
        let speed = |i: usize| (frames[i + 1].eye - frames[i].eye) * 1000.0;
        let turn = |i: usize| (frames[i + 1].forward - frames[i].forward) * 1000.0;
        for i in 0..2999 {
            assert!(speed(i).distance(speed(i + 1)) < 0.05, "{i}");
            assert!(turn(i).distance(turn(i + 1)) < 0.05, "{i}");
        }
        // Equal steps on a straight line.
        let line = parse("0,0,0,0,0,-1\n1,0,0,0,0,-1\n2,0,0,0,0,-1").unwrap().frames("p.txt", 5).unwrap();
        assert!((0..5).all(|i| (line[i].eye.x - 0.5 * i as f64).abs() < 1e-12));
    }

    #[test]
    fn bad_paths_are_named_by_line() {
        for (text, what) in [
            ("", "p.txt: has no camera for a path"),
            ("# nothing\n\n0,0,0,1,0,0\n", "p.txt: has one camera for a path"),
            ("0,0,0,1,0,0\n\n0,0,1,0,0\n", "p.txt: line 3: expected six numbers"),
            ("0,0,0,1,0,0\n0,0,1,0,0,0\n", "p.txt: line 2: the direction (fourth to sixth number) is zero"),
            ("0,0,0,1,0,0,180\n", "p.txt: line 1: the field of view must be between 0 and 180"),
            ("0,0,0,1,0,0\n1: 0,0,1,0,0,1\n", "p.txt: line 2: give every camera a time, or none"),
            ("1: 0,0,0,1,0,0\n1: 0,0,1,0,0,1\n", "p.txt: line 2: the time 1 is not after 1"),
            ("0,0,0,1,0,0\n0,0,1,-3,0,0.01\n", "p.txt: line 2: the direction is opposite to that before"),
            ("x: 0,0,0,1,0,0\n", "p.txt: line 1: x is no time"),
            ("inf: 0,0,0,1,0,0\n", "p.txt: line 1: inf is no time"),
        ] {
            let error = parse(text).map(|_| ()).unwrap_err();
            assert!(error.starts_with(what), "{text:?}: {error}");
        }
    }

    #[test]
    fn a_turn_keeps_its_distance_and_looks_at_the_middle() {
        let camera = Camera {
            eye: [3.0, 2.0, 1.0],
            forward: [0.0, 0.0, -1.0],
            up: [0.0, 2.0, 0.0],
            fov_degrees: 60.0,
            near: 0.1,
            far: 9.0,
        };
        let frames = turn(&camera, DVec3::new(3.0, 0.0, -4.0), 4);
        let near = |a: [f64; 3], b: [f64; 3]| DVec3::from(a).distance(b.into()) < 1e-12;
        assert!(frames.len() == 4 && near(frames[0].eye, [3.0, 2.0, 1.0]));
        assert!(near(frames[1].eye, [8.0, 2.0, -4.0]) && near(frames[1].forward, [-1.0, 0.0, 0.0]));
        assert!(near(frames[2].eye, [3.0, 2.0, -9.0]) && near(frames[2].forward, [0.0, 0.0, 1.0]));
    }
}
