//! A robot written from docs/wire.md alone, as examples/minimal_robot.py: it stands still, reports itself and a ball, answers
//! queries, and prints what its team agrees on. The team's grid it takes from the status of a board.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use zenoh::{sample::Sample, Result, Wait};

const ENCODING: &str = "application/msgpack;cop.v1";
const STEP: f64 = 0.05; // nats between two levels

#[derive(Clone, Deserialize, Serialize)]
struct Grid {
    shape: [usize; 2], // one or three axes are not for this robot
    cell: f64,
    origin: [f64; 2],
    #[serde(skip_serializing_if = "Option::is_none")] // none: it has its default
    unit: Option<String>,
}

#[derive(Deserialize, Serialize)]
struct Belief {
    grid: Grid,
    lo: [usize; 2],
    r#box: [usize; 2],
    step: f64,
    #[serde(default)]
    rest: f64,
    data: Vec<u8>,
}

#[derive(Clone, Serialize)]
#[serde(untagged)] // of a field of a message: the value alone, without the name of the variant
enum Value<'a> {
    Whole(u64),
    Float(f64),
    Text(&'a str),
    One(&'a Belief),
    All(&'a BTreeMap<String, Belief>),
    Names(Vec<&'a String>),
}
use Value::*;

/// What is read: of a board's Status the grid, of a Clock tick and time, of a Consensus tick, subject and belief.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Heard {
    grid: Option<Grid>,
    tick: u64,
    time: f64,
    subject: String,
    belief: Option<Belief>,
}

/// A round hill about a place, as in docs/bytes.md; the box is the whole grid.
fn hill(grid: &Grid, at: [f64; 2], sigma: f64) -> Result<Belief> {
    let away = |axis: usize, i: usize| grid.origin[axis] + (i as f64 + 0.5) * grid.cell - at[axis];
    let cells = (0..grid.shape[0]).flat_map(|x| (0..grid.shape[1]).map(move |y| (x, y))); // the last axis runs fastest
    let squares: Vec<f64> = cells.map(|(x, y)| (away(0, x).powi(2) + away(1, y).powi(2)) / sigma.powi(2)).collect();
    let least = squares.iter().copied().fold(f64::MAX, f64::min);
    let logs = || squares.iter().map(|square| (least - square) / 2.0); // of the masses, relative to the peak
    let level = |log: f64| (255.0 + log / STEP).round().max(0.0) as u8; // 0: in the rest
    let rest = logs().filter(|log| level(*log) == 0).map(f64::exp).sum::<f64>() / logs().map(f64::exp).sum::<f64>();
    let levels: Vec<u8> = std::iter::once(0).chain(logs().map(level)).collect();
    let differences: Vec<u8> = levels.windows(2).map(|pair| pair[1].wrapping_sub(pair[0])).collect();
    let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), Default::default());
    zlib.write_all(&differences)?;
    Ok(Belief { grid: grid.clone(), lo: [0, 0], r#box: grid.shape, step: STEP, rest, data: zlib.finish()? })
}

/// The centre of the likeliest cell; none where the bytes are no box of levels.
fn likeliest(Belief { grid, lo, r#box: size, data, .. }: &Belief) -> Option<[f64; 2]> {
    let (mut levels, cells) = (Vec::new(), size[0].checked_mul(size[1])?);
    flate2::read::ZlibDecoder::new(&data[..]).take(cells as u64).read_to_end(&mut levels).ok()?;
    for i in 1..levels.len() {
        levels[i] = levels[i - 1].wrapping_add(levels[i]); // until here differences
    }
    let best = (0..levels.len()).max_by_key(|i| levels[*i])?;
    let cell = [lo[0] + best / size[1], lo[1] + best % size[1]];
    Some([0, 1].map(|axis| grid.origin[axis] + (cell[axis] as f64 + 0.5) * grid.cell))
}

fn unpack(sample: &Sample) -> Option<Heard> {
    rmp_serde::from_slice(&sample.payload().to_bytes()).ok()
}

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [team, sub_team, me, endpoint] = &args[..] else {
        return Err("give a team, a sub-team, a name and an endpoint: demo a rust tcp/127.0.0.1:7447".into());
    };
    let home = format!("cop/{team}/{sub_team}");
    let mut config = zenoh::Config::from_json5("{mode: 'client', scouting: {multicast: {enabled: false}}}")?;
    config.insert_json5("connect/timeout_ms", "60000")?; // until a router answers
    config.insert_json5("connect/endpoints", &format!("['{endpoint}']"))?;
    let session = zenoh::open(config).wait()?;
    let statuses = session.declare_subscriber(format!("{home}/status/*")).wait()?;
    let grid = statuses.iter().find_map(|sample| unpack(&sample)?.grid).ok_or("the session was closed")?;
    drop(statuses); // a subscriber that nobody reads would soon stop all the others
    let mut beliefs = BTreeMap::from([("object/ball".to_string(), hill(&grid, [15.0, 15.0], 2.0)?)]);
    beliefs.insert(format!("robot/{me}"), hill(&grid, [10.0, 10.0], 1.0)?);
    let mut said = Vec::new(); // keys and messages
    for (subject, belief) in &beliefs {
        let fields = vec![("source", Text(me)), ("subject", Text(subject)), ("belief", One(belief))];
        said.push((format!("{home}/report/{me}/{subject}"), fields));
    }
    said.push((format!("cop/{team}/score/solo/{me}"), vec![("robot", Text(me)), ("beliefs", All(&beliefs))]));
    let mut status = vec![("process", Text(me)), ("kind", Text("robot")), ("phase", Text("reported"))];
    status.push(("subjects", Names(beliefs.keys().collect())));
    said.push((format!("{home}/status/{me}"), status)); // last: with it the tick is done
    let newest = Arc::new(Mutex::new(BTreeMap::new()));
    for (key, _) in &said {
        let (own, newest) = (key.clone(), newest.clone());
        let answer = session.declare_queryable(key).callback(move |query| {
            if let Some(bytes) = newest.lock().unwrap().get(&own) {
                query.reply(&own, bytes).encoding(ENCODING).wait().ok();
            }
        });
        answer.background().wait()?;
    }
    let _member = session.liveliness().declare_token(format!("{home}/member/{me}")).wait()?; // held until it is dropped
    let agreed = session.declare_subscriber(format!("{home}/agreed/**")).callback(|sample| {
        let place = |heard: Heard| Some((heard.tick, heard.subject, likeliest(&heard.belief?)?));
        if let Some((tick, subject, [x, y])) = unpack(&sample).and_then(place) {
            println!("{tick} {subject} {x:.3} {y:.3}");
        }
    });
    agreed.background().wait()?;
    let (clocks, mut led) = (session.declare_subscriber(format!("cop/{team}/world/clock")).wait()?, false);
    loop {
        let clock = clocks.recv_timeout(Duration::from_millis(200))?.and_then(|sample| unpack(&sample));
        if clock.is_none() && led {
            continue; // at each Clock, whoever sends it; until the first one by Unix time
        }
        led = clock.is_some();
        let unix = SystemTime::now().duration_since(UNIX_EPOCH)?.as_secs_f64();
        let (tick, time) = clock.map_or(((unix * 5.0) as u64, unix), |clock| (clock.tick, clock.time));
        for (key, fields) in &said {
            let mut message = BTreeMap::from([("version", Whole(1)), ("tick", Whole(tick)), ("time", Float(time))]);
            message.extend(fields.clone());
            let mut bytes = Vec::new();
            let maps = rmp_serde::Serializer::new(&mut bytes).with_struct_map(); // not arrays; and `bin` for bytes
            message.serialize(&mut maps.with_bytes(rmp_serde::config::BytesMode::ForceIterables))?;
            newest.lock().unwrap().insert(key.clone(), bytes.clone());
            session.put(key, bytes).encoding(ENCODING).wait()?;
        }
    }
}
