//! A robot that takes part in a joint, written from docs/wire.md and its pages alone. It reads Readings and Clock as `robot-agent`
//! does, runs a filter of its own, reports what it believes with the evidence for the team, and prints where the team has it:
//!
//!     cargo run --bin joint_robot demo a r1 tcp/127.0.0.1:7447
//!
//! It begins with a fix and a heading, takes nothing back from the team, and believes every Clock.

mod evidence;
mod filter;
mod messages;

use filter::{Filter, Sensors};
use messages::{gaussian, packed, Clock, Fault, Grid, Readings, Report, Solo, Status};
use serde::{de::DeserializeOwned, Deserialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::{mpsc, Arc, Mutex};
use std::time::{Duration, Instant};
use zenoh::{key_expr::KeyExpr, sample::SampleKind, Session, Wait};

const ENCODING: &str = "application/msgpack;cop.v1";
const SECOND: Duration = Duration::from_secs(1);

/// What reaches the robot.
enum Event {
    Clock(Clock),
    Readings(Box<Readings>),
    World(bool), // whether it holds its token
}

/// Of a board: its grid.
#[derive(Deserialize)]
struct Grids {
    grid: Option<Grid>,
}

/// Of what is agreed about the robot.
#[derive(Deserialize)]
struct Agreed {
    tick: u64,
    state: Option<State>,
}

#[derive(Deserialize)]
struct State {
    mean: Vec<f64>,
}

#[derive(Deserialize)]
struct Refusal {
    board: String,
    reason: String,
    text: Option<String>,
}

fn main() -> Result<(), Fault> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [team, sub_team, me, endpoint, settings @ ..] = &args[..] else {
        return Err(
            "give a team, a sub-team, a name and an endpoint: demo a r1 tcp/127.0.0.1:7447 [along=0.5 ...]".into()
        );
    };
    let sensors = Sensors::new(settings)?;
    let mut config = zenoh::Config::from_json5("{mode: 'client', scouting: {multicast: {enabled: false}}}")?;
    config.insert_json5("connect/timeout_ms", "60000")?; // until a router answers
    config.insert_json5("connect/endpoints", &format!("['{endpoint}']"))?;
    let session = zenoh::open(config).wait()?;
    let (home, world) = (format!("cop/{team}/{sub_team}"), format!("cop/{team}/world"));
    let solo = format!("cop/{team}/score/solo/{me}");

    let statuses = session.declare_subscriber(format!("{home}/status/*")).wait()?;
    let told = statuses.iter().find_map(|sample| unpacked::<Grids>(&sample.payload().to_bytes())?.grid);
    let grid = told.ok_or("the session was closed")?;
    drop(statuses); // a subscriber that nobody reads would soon stop all the others

    let newest: Newest = Newest::default();
    for keys in [format!("{home}/report/{me}/**"), format!("{home}/status/{me}"), solo.clone()] {
        let newest = newest.clone();
        let answer = session.declare_queryable(keys).callback(move |query| {
            for (key, bytes) in newest.lock().unwrap().iter().filter(|(key, _)| query.key_expr().intersects(key)) {
                query.reply(key, bytes).encoding(ENCODING).wait().ok();
            }
        });
        answer.background().wait()?;
    }
    let (sender, events) = mpsc::channel();
    let to = sender.clone();
    hear(&session, format!("{world}/clock"), move |clock| drop(to.send(Event::Clock(clock))))?;
    let to = sender.clone();
    hear(&session, format!("{world}/reading/{me}"), move |readings| drop(to.send(Event::Readings(readings))))?;
    hear(&session, format!("{home}/agreed/robot/{me}"), |agreed: Agreed| {
        if let Some([x, y, heading, ..]) = agreed.state.as_ref().map(|state| &state.mean[..]) {
            println!("{} {x:.3} {y:.3} {heading:.3}", agreed.tick);
        }
    })?;
    hear(&session, format!("{home}/refused/{me}"), |refusal: Refusal| {
        eprintln!("{} refused: {} {}", refusal.board, refusal.reason, refusal.text.unwrap_or_default());
    })?;
    let alive =
        session.liveliness().declare_subscriber(format!("{world}/alive")).history(true).callback(move |sample| {
            let _ = sender.send(Event::World(sample.kind() == SampleKind::Put));
        });
    alive.background().wait()?;
    let _member = session.liveliness().declare_token(format!("{home}/member/{me}")).wait()?; // held until it is dropped

    let mut robot = Robot {
        session,
        newest,
        home,
        solo,
        me: me.clone(),
        grid,
        sensors,
        world: false,
        clock: None,
        at: At::default(),
    };
    let mut last = Instant::now();
    robot.idle()?;
    loop {
        match events.recv_timeout(SECOND.saturating_sub(last.elapsed())) {
            Ok(event) => robot.act(event)?,
            Err(_) => {
                robot.say_status()?; // once a second
                last = Instant::now();
            }
        }
    }
}

type Newest = Arc<Mutex<Vec<(KeyExpr<'static>, Vec<u8>)>>>;

/// Where the robot is in a run; another run begins with a new one.
#[derive(Default)]
struct At {
    run: String,
    taken: Option<(u64, f64)>, // tick and time of the newest Readings in the filter
    reported: Option<u64>,
    filter: Option<Filter>, // none while the robot does not know where it is
    evidence: Option<Value>,
}

struct Robot {
    session: Session,
    newest: Newest, // keys and messages of the last tick, the Status last
    home: String,
    solo: String,
    me: String,
    grid: Grid,
    sensors: Sensors,
    world: bool, // whether its token is there
    clock: Option<(Clock, Instant)>, // and when it came
    at: At,
}

/// For so long a Clock counts after the world's token is gone: the token of the next world may come after its first Readings.
const GONE: Duration = Duration::from_secs(5);

impl Robot {
    /// The Clock that is followed.
    fn followed(&self) -> Option<&Clock> {
        self.clock.as_ref().filter(|(_, came)| self.world || came.elapsed() < GONE).map(|(clock, _)| clock)
    }

    fn act(&mut self, event: Event) -> Result<(), Fault> {
        match event {
            Event::World(here) => {
                self.world = here;
                return self.say_status();
            }
            Event::Readings(readings) => {
                if readings.run != self.at.run {
                    self.at = At { run: readings.run.clone(), ..At::default() };
                }
                if self.at.taken.is_some_and(|(tick, _)| readings.tick <= tick) {
                    return Ok(()); // repeated
                }
                self.take(&readings);
            }
            Event::Clock(clock) => {
                let again = clock.run == self.at.run && self.at.reported == Some(clock.tick);
                self.clock = Some((clock, Instant::now()));
                if again {
                    return self.say_all();
                }
            }
        }
        match self.at.taken {
            Some((tick, time)) if self.at.reported != Some(tick) && self.due(tick) => self.report(tick, time),
            _ => Ok(()),
        }
    }

    /// Whether a tick may be reported: in lockstep once its Clock is there, else at once.
    fn due(&self, tick: u64) -> bool {
        match self.followed() {
            Some(clock) => clock.mode != "lockstep" || (&clock.run, clock.tick) == (&self.at.run, tick),
            None => !self.world,
        }
    }

    fn take(&mut self, readings: &Readings) {
        let at = &mut self.at;
        at.taken = Some((readings.tick, readings.time));
        if let Some(filter) = &mut at.filter {
            filter.take(readings);
        }
        if at.filter.as_ref().is_none_or(Filter::lost) {
            let anew = Filter::begin(&self.sensors, readings);
            at.filter.as_mut().map(|filter| filter.doubt(readings)); // where the Readings cannot tell it
            at.filter = anew.or(at.filter.take());
        }
        at.evidence = at.filter.as_ref().map(|filter| evidence::evidence(filter, readings));
    }

    fn report(&mut self, tick: u64, time: f64) -> Result<(), Fault> {
        let me = format!("robot/{}", self.me);
        let mut beliefs = BTreeMap::new();
        if let Some(filter) = &self.at.filter {
            let (place, area) = (filter.pose.mean.xy(), filter.pose.covariance.fixed_view::<2, 2>(0, 0).into_owned());
            beliefs.insert(me.clone(), gaussian(&self.grid, place, area)?);
            let known = |sigma: f64| sigma < self.grid.cell * self.grid.shape[0].min(self.grid.shape[1]) as f64 / 4.0;
            for (name, object) in filter.objects.iter().filter(|(_, object)| known(object.covariance.trace().sqrt())) {
                beliefs.insert(name.clone(), gaussian(&self.grid, object.mean, object.covariance)?);
            }
        }
        let mut said = Vec::new();
        for (subject, belief) in &beliefs {
            let evidence = self.at.evidence.as_ref().filter(|_| *subject == me);
            let report = Report { version: 1, source: &self.me, subject, tick, time, belief, evidence };
            said.push((format!("{}/report/{}/{subject}", self.home, self.me).try_into()?, packed(&report)?));
        }
        if self.followed().is_some() {
            let solo = Solo { version: 1, robot: &self.me, tick, time, beliefs: &beliefs };
            said.push((self.solo.clone().try_into()?, packed(&solo)?));
        }
        said.push(self.status(tick, time, "reported", beliefs.keys().collect())?); // last: with it the tick is done
        *self.newest.lock().unwrap() = said;
        self.at.reported = Some(tick);
        self.say_all()
    }

    /// Before the first tick: a robot counts once it has said something.
    fn idle(&mut self) -> Result<(), Fault> {
        let status = self.status(0, 0.0, "idle", Vec::new())?;
        *self.newest.lock().unwrap() = vec![status];
        self.say_all()
    }

    fn status(
        &self,
        tick: u64,
        time: f64,
        phase: &str,
        subjects: Vec<&String>,
    ) -> Result<(KeyExpr<'static>, Vec<u8>), Fault> {
        let status = Status { version: 1, process: &self.me, kind: "robot", tick, time, phase, subjects };
        Ok((format!("{}/status/{}", self.home, self.me).try_into()?, packed(&status)?))
    }

    fn say_all(&self) -> Result<(), Fault> {
        for (key, bytes) in self.newest.lock().unwrap().iter() {
            self.session.put(key, bytes).encoding(ENCODING).wait()?;
        }
        Ok(())
    }

    fn say_status(&self) -> Result<(), Fault> {
        if let Some((key, bytes)) = self.newest.lock().unwrap().last() {
            self.session.put(key, bytes).encoding(ENCODING).wait()?;
        }
        Ok(())
    }
}

/// Hand on what is a proper message of this version; anything else changes nothing.
fn hear<T: DeserializeOwned>(
    session: &Session,
    key: String,
    then: impl Fn(T) + Send + Sync + 'static,
) -> Result<(), Fault> {
    let subscriber = session.declare_subscriber(key).callback(move |sample| {
        if let Some(message) = unpacked(&sample.payload().to_bytes()) {
            then(message);
        }
    });
    subscriber.background().wait()
}

fn unpacked<T: DeserializeOwned>(bytes: &[u8]) -> Option<T> {
    #[derive(Deserialize)]
    struct Version {
        version: u64,
    }
    rmp_serde::from_slice::<Version>(bytes).ok().filter(|message| message.version == 1)?;
    rmp_serde::from_slice(bytes).ok()
}
