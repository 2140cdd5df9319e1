//! The messages of docs/messages.md, as far as this robot needs them, and a Gaussian as bytes (docs/bytes.md).
//! Fields that have their default are left out.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Write;

pub type Fault = Box<dyn std::error::Error + Send + Sync>;

#[derive(Clone, Default, Deserialize)]
#[serde(default)]
pub struct Clock {
    pub run: String,
    pub tick: u64,
    pub mode: String,
}

#[derive(Clone, Default, Deserialize)]
#[serde(default)]
pub struct Readings {
    pub run: String,
    pub tick: u64,
    pub time: f64,
    pub odometry: Option<Odometry>,
    pub compass: Option<f64>,
    pub compass_sigma: Option<f64>,
    pub fix: Option<Fix>,
    pub sightings: Vec<Sighting>,
    pub seen: Vec<Value>, // sightings of other kinds: handed on as they are
}

#[derive(Clone, Copy, Default, Deserialize)]
pub struct Odometry {
    pub distance: f64,
    pub turn: f64,
    pub dt: f64,
    pub distance_sigma: Option<f64>,
    pub turn_sigma: Option<f64>,
}

#[derive(Clone, Deserialize)]
pub struct Fix {
    pub position: [f64; 2],
    pub sigma: f64,
    pub heading: Option<f64>,
    pub heading_sigma: Option<f64>,
}

#[derive(Clone, Deserialize)]
pub struct Sighting {
    pub subject: String,
    pub range: f64,
    pub bearing: f64,
    pub landmark: Option<[f64; 2]>,
    #[serde(default)]
    pub age: f64,
    pub range_sigma: Option<f64>,
    pub bearing_sigma: Option<f64>,
    pub confidence: Option<f64>,
}

#[derive(Clone, Deserialize, Serialize)]
pub struct Grid {
    pub shape: [usize; 2], // one or three axes are not for this robot
    pub cell: f64,
    pub origin: [f64; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    unit: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    frame: Option<String>,
}

#[derive(Clone, Serialize)]
pub struct Belief {
    grid: Grid,
    lo: [usize; 2],
    r#box: [usize; 2],
    step: f64,
    rest: f64,
    data: Vec<u8>,
}

/// A Gaussian as masses of cells: a box of 5.5 sigmas to each side, in levels of 0.05 nats.
pub fn gaussian(grid: &Grid, mean: Vector2<f64>, covariance: Matrix2<f64>) -> Result<Belief, Fault> {
    let covariance = covariance + Matrix2::identity() * (grid.cell * grid.cell / 12.0); // with the width of a cell
    let information = covariance.try_inverse().ok_or("a covariance without an inverse")?;
    let centre = |axis: usize, i: usize| grid.origin[axis] + (i as f64 + 0.5) * grid.cell;
    let cell = |axis: usize, sigmas: f64| {
        let place = mean[axis] + sigmas * covariance[(axis, axis)].sqrt();
        ((place - grid.origin[axis]) / grid.cell).clamp(0.0, (grid.shape[axis] - 1) as f64) as usize
    };
    let lo = [cell(0, -5.5), cell(1, -5.5)];
    let size = [0, 1].map(|axis| cell(axis, 5.5) + 1 - lo[axis]);
    let cells = (0..size[0]).flat_map(|x| (0..size[1]).map(move |y| (x, y))); // the last axis runs fastest
    let logs: Vec<f64> = cells
        .map(|(x, y)| Vector2::new(centre(0, lo[0] + x), centre(1, lo[1] + y)) - mean)
        .map(|off| -0.5 * off.dot(&(information * off)))
        .collect();
    let peak = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let level = |log: f64| (255.0 + (log - peak) / 0.05).round().max(0.0) as u8; // 0: in the rest
    let mass = |logs: &mut dyn Iterator<Item = &f64>| logs.map(|log| (log - peak).exp()).sum::<f64>();
    let rest = mass(&mut logs.iter().filter(|log| level(**log) == 0)) / mass(&mut logs.iter());
    let levels: Vec<u8> = std::iter::once(0).chain(logs.iter().map(|log| level(*log))).collect();
    let differences: Vec<u8> = levels.windows(2).map(|pair| pair[1].wrapping_sub(pair[0])).collect();
    let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), Default::default());
    zlib.write_all(&differences)?;
    Ok(Belief { grid: grid.clone(), lo, r#box: size, step: 0.05, rest, data: zlib.finish()? })
}

#[derive(Serialize)]
pub struct Report<'a> {
    pub version: u64,
    pub source: &'a str,
    pub subject: &'a str,
    pub tick: u64,
    pub time: f64,
    pub belief: &'a Belief,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub evidence: Option<&'a Value>,
}

#[derive(Serialize)]
pub struct Solo<'a> {
    pub version: u64,
    pub robot: &'a str,
    pub tick: u64,
    pub time: f64,
    pub beliefs: &'a BTreeMap<String, Belief>,
}

#[derive(Serialize)]
pub struct Status<'a> {
    pub version: u64,
    pub process: &'a str,
    pub kind: &'a str,
    pub tick: u64,
    pub time: f64,
    pub phase: &'a str,
    pub subjects: Vec<&'a String>,
}

pub fn packed(message: &impl Serialize) -> Result<Vec<u8>, Fault> {
    let mut bytes = Vec::new();
    let maps = rmp_serde::Serializer::new(&mut bytes).with_struct_map(); // not arrays; and `bin` for bytes
    message.serialize(&mut maps.with_bytes(rmp_serde::config::BytesMode::ForceIterables))?;
    Ok(bytes)
}
