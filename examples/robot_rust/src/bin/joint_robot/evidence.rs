//! What a robot tells a joint in one tick (docs/bytes.md, "Evidence for a joint").

use crate::filter::{unnamed, Filter, Pose};
use crate::messages::Readings;
use nalgebra::Matrix3;
use serde_json::{json, Value};

const MOST: usize = 64; // sightings of a kind in one message

pub fn evidence(filter: &Filter, readings: &Readings) -> Value {
    let sensors = &filter.sensors;
    let [distance, turn, time, moving, along, across, heading] = filter.travelled.into();
    let wheels = [sensors.of("scale"), sensors.of("turn_scale")]; // the filter does not know them, the joint finds them
    let gained = filter.gained.as_ref().filter(|gained| gained.information != Matrix3::zeros());
    let increment = gained.map(|gained| {
        let vector = [gained.vector.as_slice(), &[0.0; 6]].concat();
        let information = triangle(&gained.information, [0.0, 0.0]);
        json!({"reference": nine(&gained.prediction), "information": information, "vector": vector})
    });
    let mut marks = 0..; // unnamed sightings are numbered, those in `sightings` first
    let mut mark = |subject: &str| unnamed(subject).then(|| marks.next()).flatten();
    let (mut relatives, mut seen) = (Vec::new(), Vec::new());
    for sighting in &readings.sightings {
        let (subject, [range, bearing]) = (&sighting.subject, sensors.sigmas(sighting.range));
        let mark = mark(subject);
        if sighting.landmark.is_none() && !subject.starts_with("landmark/") {
            relatives.push(json!({
                "subject": subject,
                "range": sighting.range,
                "bearing": sighting.bearing,
                "range_variance": sighting.range_sigma.unwrap_or(range).powi(2),
                "bearing_variance": sighting.bearing_sigma.unwrap_or(bearing).powi(2),
                "age": sighting.age,
                "confidence": sighting.confidence.unwrap_or(1.0),
                "mark": mark,
            }));
        }
    }
    for told in &readings.seen {
        let subject = told["subject"].as_str().unwrap_or_default();
        let mark = mark(subject);
        let covariance = told["covariance"].as_array().is_some_and(|numbers| !numbers.is_empty());
        if covariance && told["landmark"].is_null() && !subject.starts_with("landmark/") {
            seen.push(told.clone());
            seen.last_mut().map(|told| told["mark"] = json!(mark));
        }
    }
    relatives.truncate(MOST);
    seen.truncate(MOST);
    let told = readings.sightings.iter().any(|sighting| sighting.range_sigma.is_some());
    json!({
        "epoch": filter.epoch,
        "travelled": {
            "distance": distance, "turn": turn, "time": time, "moving": moving,
            "along": along, "across": across, "heading": heading,
        },
        "nuisance": {
            "forward": 1.0, "turn": 1.0, "sigmas": [wheels[0], wheels[1], 0.0, 0.0, 0.0, 0.0],
            "walks": [0.0, 0.0, 0.0], "memory": [0.0, 0.0, 0.0],
        },
        "state": {"mean": nine(&filter.pose), "covariance": triangle(&filter.pose.covariance, wheels)},
        "increment": increment,
        "relatives": relatives,
        "profile": if told { Vec::new() } else { sensors.profile() },
        "seen": seen,
    })
}

/// The nine states of a joint: the pose, both scales of the wheels, which are 1, and other errors, which are 0.
fn nine(pose: &Pose) -> [f64; 9] {
    let [x, y, heading] = pose.mean.into();
    [x, y, heading, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
}

/// The upper triangle, row by row, of a 9 x 9 matrix: of the pose, and of both scales by their sigmas.
fn triangle(pose: &Matrix3<f64>, wheels: [f64; 2]) -> Vec<f64> {
    let entry = |i: usize, j: usize| match (i, j) {
        (_, 0..=2) => pose[(i, j)],
        (3, 3) | (4, 4) => wheels[i - 3].powi(2),
        _ => 0.0,
    };
    (0..9).flat_map(|i| (i..9).map(move |j| entry(i, j))).collect()
}
