//! What the robot knows from its own sensors alone: its pose, a Gaussian of x, y and heading, and where objects are.
//! Beside that what evidence for a joint is made of: how far it drove, and what a tick said of its pose.

use crate::messages::{Odometry, Readings, Sighting};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Rotation2, SMatrix, SVector, Vector1, Vector2, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// How exact the sensors are, where the Readings do not say it. Lengths are in the grid's unit, angles in radians.
const DEMO: [(&str, f64); 13] = [
    ("along", 0.5),       // of the way, per square root of a second in motion
    ("across", 0.0),      // across the way, likewise
    ("drift", 0.0),       // of the heading, likewise
    ("turn", 0.01),       // of a turn, per square root of a radian
    ("scale", 0.05),      // of the share of a way by which it may be off for ever
    ("turn_scale", 0.05), // the same of a turn
    ("compass", 0.01),
    ("gain", 0.05),   // of the camera of the simulated world,
    ("floor", 0.5),   // and its least sigma of a place
    ("range", 0.0),   // above 0: of another camera, its sigma of a range,
    ("share", 0.0),   // with so much of the range beside it,
    ("bearing", 0.0), // and its sigma of a bearing
    ("objects", 0.3), // how objects walk, per square root of a second
];

#[derive(Clone)]
pub struct Sensors(BTreeMap<String, f64>);

impl Sensors {
    /// Those of `blackboard demo`, changed by texts such as `along=0.05`.
    pub fn new(settings: &[String]) -> Result<Sensors, String> {
        let mut numbers = BTreeMap::from(DEMO.map(|(name, number)| (name.to_string(), number)));
        for setting in settings {
            let known = setting.split_once('=').and_then(|(name, text)| Some((numbers.get_mut(name)?, text)));
            let (number, text) = known.ok_or(format!("{setting}: no setting of this robot"))?;
            *number = text.parse().map_err(|_| format!("{setting}: give a number"))?;
        }
        Ok(Sensors(numbers))
    }

    pub fn of(&self, name: &str) -> f64 {
        self.0[name]
    }

    /// The sigma of a place in each coordinate as the simulated camera sees it, by the true distance.
    fn seen(&self, distance: f64) -> f64 {
        let off = (distance - 7.5).abs();
        let sigma = if (3.0..=11.0).contains(&distance) { 8.0 * off } else { 20.0 * off.max(1.0).ln() };
        self.of("floor").max(self.of("gain") * sigma)
    }

    /// The same as pairs of distance and variance; empty for the other camera.
    pub fn profile(&self) -> Vec<[f64; 2]> {
        let all = (4..=52).map(|quarter| quarter as f64 / 4.0);
        all.filter(|_| self.of("range") == 0.0).map(|distance| [distance, self.seen(distance).powi(2)]).collect()
    }

    /// The sigmas of a range and a bearing to what is so far away.
    pub fn sigmas(&self, distance: f64) -> [f64; 2] {
        match self.of("range") > 0.0 {
            true => [self.of("range").hypot(self.of("share") * distance), self.of("bearing")],
            false => [self.seen(distance), self.seen(distance) / distance.max(1.0)],
        }
    }

    /// The covariance of a sighting's place in the robot's frame. `distance`: how far away that is, as far as known.
    fn noise(&self, sighting: &Sighting, distance: f64) -> Matrix2<f64> {
        let [range, bearing] = self.sigmas(distance);
        let range = sighting.range_sigma.unwrap_or(range);
        let across = distance.max(1e-3) * sighting.bearing_sigma.unwrap_or(bearing);
        let turned = *Rotation2::new(sighting.bearing).matrix();
        turned * Matrix2::new(range * range, 0.0, 0.0, across * across) * turned.transpose()
    }
}

#[derive(Clone)]
pub struct Pose {
    pub mean: Vector3<f64>,
    pub covariance: Matrix3<f64>,
}

impl Pose {
    /// Where a place of the team's frame is in the robot's, and the derivative of that by the pose.
    fn view(&self, place: Vector2<f64>) -> (Vector2<f64>, Matrix2x3<f64>) {
        let back = *Rotation2::new(-self.mean.z).matrix();
        let seen = back * (place - self.mean.xy());
        let columns = [-back.column(0), -back.column(1), Vector2::new(seen.y, -seen.x)];
        (seen, Matrix2x3::from_columns(&columns))
    }
}

/// What a tick says about the pose: the likelihood exp(v d - d I d / 2) of d = pose - prediction.
pub struct Gained {
    pub prediction: Pose,
    pub information: Matrix3<f64>,
    pub vector: Vector3<f64>,
    places: Vec<bool>, // of each measurement of the place whether it was taken
}

impl Gained {
    /// A measurement: by how much it is off the prediction, the derivative by the pose, its noise. Beyond 99.9 % it is left out.
    fn measure<const N: usize>(&mut self, off: SVector<f64, N>, by: SMatrix<f64, N, 3>, noise: SMatrix<f64, N, N>) {
        let spread = by * self.prediction.covariance * by.transpose() + noise;
        let inverses = spread.try_inverse().zip(noise.try_inverse());
        let taken = inverses.filter(|(inverse, _)| off.dot(&(inverse * off)) < [10.8, 13.8][N - 1]);
        if let Some((_, weight)) = taken {
            self.information += by.transpose() * weight * by;
            self.vector += by.transpose() * weight * off;
        }
        self.places.push(taken.is_some());
    }
}

/// Where an object is, and how its errors go with those of the pose from which it was seen.
pub struct Object {
    pub mean: Vector2<f64>,
    pub covariance: Matrix2<f64>,
    cross: Matrix2x3<f64>,
    missed: bool, // whether its newest sighting contradicts it
}

fn wrap(angle: f64) -> f64 {
    (angle + PI).rem_euclid(2.0 * PI) - PI
}

/// Sums since the epoch began: distance, turn, time, time in motion, and the variances along, across and of the heading.
pub type Travelled = SVector<f64, 7>;

pub struct Filter {
    pub sensors: Sensors,
    pub pose: Pose,
    pub objects: BTreeMap<String, Object>,
    pub gained: Option<Gained>, // in the newest tick; none: it has just begun
    pub epoch: u64,
    pub travelled: Travelled,
    tick: u64,
    time: f64,
    speed: f64,
    refuted: u32, // ticks in succession whose measurements contradict the pose
}

impl Filter {
    /// Begin with a fix and a heading; none where the Readings lack one of the two.
    pub fn begin(sensors: &Sensors, readings: &Readings) -> Option<Filter> {
        let fix = readings.fix.as_ref()?;
        let told = fix.heading.map(|heading| (heading, fix.heading_sigma.unwrap_or(0.05)));
        let compass =
            readings.compass.map(|heading| (heading, readings.compass_sigma.unwrap_or(sensors.of("compass"))));
        let (heading, sigma) = told.or(compass)?;
        let mean = Vector3::new(fix.position[0], fix.position[1], wrap(heading));
        let variances = Vector3::new(fix.sigma, fix.sigma, sigma).map(|sigma| sigma * sigma);
        let mut filter = Filter {
            sensors: sensors.clone(),
            pose: Pose { mean, covariance: Matrix3::from_diagonal(&variances) },
            objects: BTreeMap::new(),
            epoch: epoch(readings),
            gained: None,
            travelled: Travelled::zeros(),
            tick: readings.tick,
            time: readings.time,
            speed: 0.0,
            refuted: 0,
        };
        filter.look(readings);
        Some(filter)
    }

    /// Whether what it measures contradicts its pose for long.
    pub fn lost(&self) -> bool {
        self.refuted >= 3 || !self.pose.mean.iter().all(|number| number.is_finite())
    }

    /// Begin another epoch at the same pose, which is known less well than it was thought to be.
    pub fn doubt(&mut self, readings: &Readings) {
        self.pose.covariance *= 25.0;
        self.objects.clear();
        (self.epoch, self.travelled, self.gained, self.refuted) = (epoch(readings), Travelled::zeros(), None, 0);
    }

    /// Take the Readings of a later tick in.
    pub fn take(&mut self, readings: &Readings) {
        self.drive(readings);
        let gained = self.gain(readings);
        match gained.places.contains(&true) {
            true => self.refuted = 0,
            false => self.refuted += u32::from(!gained.places.is_empty()),
        }
        self.learn(&gained);
        self.look(readings);
        self.gained = Some(gained);
    }

    /// Drive along the chord. Where Readings were lost, it may have gone anywhere meanwhile.
    fn drive(&mut self, readings: &Readings) {
        let past = (readings.time - self.time).max(0.0);
        let odometry = readings.odometry.unwrap_or(Odometry { dt: past, ..Odometry::default() });
        let Odometry { distance, turn, dt, .. } = odometry;
        let moving = if distance != 0.0 || turn != 0.0 { dt } else { 0.0 };
        let walk = |name| self.sensors.of(name).powi(2) * moving;
        let turned = walk("drift") + self.sensors.of("turn").powi(2) * turn.abs();
        let told = |sigma: Option<f64>, variance| sigma.map_or(variance, |sigma| sigma * sigma);
        let along = told(odometry.distance_sigma, walk("along"));
        let mut variances = [along, walk("across"), told(odometry.turn_sigma, turned)];
        if readings.tick > self.tick + 1 {
            let missing = (past - dt).max(0.0);
            let way = (self.speed * missing).powi(2);
            variances = [variances[0] + way, variances[1] + way, variances[2] + missing * missing];
        }
        let (sin, cos) = (self.pose.mean.z + turn / 2.0).sin_cos();
        self.pose.mean += Vector3::new(distance * cos, distance * sin, turn);
        self.pose.mean.z = wrap(self.pose.mean.z);
        let by = Matrix3::new(1.0, 0.0, -distance * sin, 0.0, 1.0, distance * cos, 0.0, 0.0, 1.0);
        let axes = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        let wheels = [self.sensors.of("scale") * distance, 0.0, self.sensors.of("turn_scale") * turn];
        let own = Vector3::from(variances) + Vector3::from(wheels).map(|off| off * off); // to this filter that is noise, too
        let noise = axes * Matrix3::from_diagonal(&own) * axes.transpose();
        self.pose.covariance = by * self.pose.covariance * by.transpose() + noise;
        for object in self.objects.values_mut() {
            object.cross *= by.transpose();
            object.covariance += Matrix2::identity() * self.sensors.of("objects").powi(2) * past;
        }
        let [along, across, heading] = variances;
        self.travelled += Travelled::from([distance, turn, past.max(dt), moving, along, across, heading]);
        self.speed = distance.abs() / dt.max(1e-3);
        (self.tick, self.time) = (readings.tick, readings.time);
    }

    /// The pose as it was that long before the end of the tick.
    fn earlier(&self, age: f64, readings: &Readings) -> Pose {
        let mut pose = self.pose.clone();
        if let Some(odometry) = &readings.odometry {
            let (sin, cos) = pose.mean.z.sin_cos();
            let step = Vector3::new(odometry.distance * cos, odometry.distance * sin, odometry.turn);
            pose.mean -= step * (age / odometry.dt.max(1e-3));
        }
        pose
    }

    /// What fix, compass and landmarks say. What is seen of mates and objects is for the team, not for this filter.
    fn gain(&self, readings: &Readings) -> Gained {
        let pose = &self.pose;
        let (information, vector) = (Matrix3::zeros(), Vector3::zeros());
        let mut gained = Gained { prediction: pose.clone(), information, vector, places: Vec::new() };
        let heading = SMatrix::<f64, 1, 3>::new(0.0, 0.0, 1.0);
        let mut headings = Vec::new();
        headings
            .extend(readings.compass.map(|told| (told, readings.compass_sigma.unwrap_or(self.sensors.of("compass")))));
        if let Some(fix) = &readings.fix {
            headings.extend(fix.heading.map(|told| (told, fix.heading_sigma.unwrap_or(0.05))));
            let off = Vector2::from(fix.position) - pose.mean.xy();
            gained.measure(off, Matrix2x3::identity(), Matrix2::identity() * fix.sigma.powi(2));
        }
        for sighting in &readings.sightings {
            if let Some(place) = sighting.landmark {
                let (expected, by) = self.earlier(sighting.age, readings).view(Vector2::from(place));
                let noise = self.sensors.noise(sighting, expected.norm());
                gained.measure(polar(sighting.range, sighting.bearing) - expected, by, noise);
            }
        }
        let count = gained.places.len();
        for (told, sigma) in headings {
            gained.measure(Vector1::new(wrap(told - pose.mean.z)), heading, Vector1::new(sigma * sigma));
        }
        gained.places.truncate(count); // a compass says nothing about the place
        gained
    }

    /// Correct the pose, and with it the objects that were seen from it.
    fn learn(&mut self, gained: &Gained) {
        let before = self.pose.covariance;
        let Some(inverse) = before.try_inverse() else { return };
        let Some(after) = (inverse + gained.information).try_inverse() else { return };
        let step = after * gained.vector;
        for object in self.objects.values_mut() {
            let share = object.cross * inverse;
            object.mean += share * step;
            object.covariance -= share * (before - after) * share.transpose();
            object.cross = share * after;
        }
        self.pose.covariance = (after + after.transpose()) / 2.0;
        self.pose.mean += step;
        self.pose.mean.z = wrap(self.pose.mean.z);
    }

    /// Correct the objects that are seen, and not the pose: a sighting of what moves counts in the joint (Schmidt's filter).
    fn look(&mut self, readings: &Readings) {
        for sighting in readings.sightings.iter().filter(|s| s.subject.starts_with("object/") && !unnamed(&s.subject)) {
            let pose = self.earlier(sighting.age, readings);
            let seen = polar(sighting.range, sighting.bearing);
            if let Some(object) = self.objects.get_mut(&sighting.subject) {
                let (expected, by) = pose.view(object.mean);
                let back = *Rotation2::new(-pose.mean.z).matrix(); // the derivative by the object
                let shared = by * object.cross.transpose() * back.transpose();
                let own = back * object.covariance * back.transpose() + by * pose.covariance * by.transpose();
                let spread = own + shared + shared.transpose() + self.sensors.noise(sighting, expected.norm());
                let (off, inverse) = (seen - expected, spread.try_inverse().unwrap_or_default());
                if off.dot(&(inverse * off)) < 13.8 {
                    let gain = (object.covariance * back.transpose() + object.cross * by.transpose()) * inverse;
                    object.mean += gain * off;
                    object.covariance -= gain * spread * gain.transpose();
                    object.cross -= gain * (back * object.cross + by * pose.covariance);
                    object.missed = false;
                    continue;
                }
                if !object.missed {
                    object.missed = true;
                    continue; // an outlier, or the first after somebody kicked it
                }
            }
            let turned = *Rotation2::new(pose.mean.z).matrix(); // new, or kicked to elsewhere
            let away = turned * seen;
            let by = Matrix2x3::new(1.0, 0.0, -away.y, 0.0, 1.0, away.x);
            let noise = turned * self.sensors.noise(sighting, sighting.range) * turned.transpose();
            let (mean, covariance) = (pose.mean.xy() + away, by * pose.covariance * by.transpose() + noise);
            self.objects.insert(
                sighting.subject.clone(),
                Object { mean, covariance, cross: by * pose.covariance, missed: false },
            );
        }
    }
}

/// Grows with each beginning: milliseconds of team time.
fn epoch(readings: &Readings) -> u64 {
    (readings.time * 1000.0).max(0.0) as u64
}

pub fn unnamed(subject: &str) -> bool {
    subject.ends_with('?')
}

fn polar(range: f64, bearing: f64) -> Vector2<f64> {
    Vector2::new(range * bearing.cos(), range * bearing.sin())
}
