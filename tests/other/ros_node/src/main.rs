//! A ROS 2 node by hiroz, which shares no code with our bridge: it prints what it hears, or drives a robot, until it is ended.
//!
//!     ros_node ENDPOINT pose|late|map|diagnostics TOPIC      prints each message; `late` asks for the last one before it came
//!     ros_node ENDPOINT graph                                prints the nodes and topics that it sees, again and again
//!     ros_node ENDPOINT drive TOPIC                          odometry of a robot that begins at (3, 4) and drives along x at 1 m/s
//!     ros_node ENDPOINT place TOPIC X Y VARIANCE             an absolute pose, again and again
//!     ros_node ENDPOINT garbage TOPIC                        odometry that is no CDR

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use hiroz::attachment::Attachment;
use hiroz::context::ZContextBuilder;
use hiroz::msg::{ZDeserializer, ZMessage};
use hiroz::qos::{QosDurability, QosProfile};
use hiroz::{Builder, MessageTypeInfo, Result, WithTypeInfo};
use hiroz_msgs::ros::builtin_interfaces::Time;
use hiroz_msgs::ros::diagnostic_msgs::DiagnosticArray;
use hiroz_msgs::ros::geometry_msgs::{Point, Pose, PoseWithCovariance, PoseWithCovarianceStamped, Quaternion};
use hiroz_msgs::ros::nav_msgs::{OccupancyGrid, Odometry};
use hiroz_msgs::ros::std_msgs::Header;

const PERIOD: Duration = Duration::from_millis(50);

fn header(frame_id: &str) -> Header {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    Header { stamp: Time { sec: now.as_secs() as i32, nanosec: now.subsec_nanos() }, frame_id: frame_id.into() }
}

fn pose(x: f64, y: f64, variance: f64) -> PoseWithCovariance {
    let orientation = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };
    let mut covariance = [0.0; 36];
    (covariance[0], covariance[7], covariance[35]) = (variance, variance, 0.01);
    PoseWithCovariance { pose: Pose { position: Point { x, y, z: 0.0 }, orientation }, covariance }
}

fn show_pose(it: PoseWithCovarianceStamped) -> String {
    let (at, c) = (it.pose.pose.position, it.pose.covariance);
    format!(
        "{} {:.3} {:.3} {:.4} {:.4} {:.4} {}",
        it.header.frame_id, at.x, at.y, c[0], c[7], c[35], it.header.stamp.sec
    )
}

fn show_map(it: OccupancyGrid) -> String {
    let peak = it.data.iter().enumerate().max_by_key(|(_, value)| **value).unwrap().0;
    let (info, width) = (&it.info, it.info.width as usize);
    format!("{} {} {} {} {} {}", info.width, info.height, info.resolution, peak % width, peak / width, it.data[peak])
}

fn show_diagnostics(it: DiagnosticArray) -> String {
    it.status.iter().map(|one| format!("{}={}", one.name, one.level)).collect::<Vec<_>>().join("; ")
}

#[tokio::main]
async fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let ctx = ZContextBuilder::default()
        .with_mode("client")
        .disable_multicast_scouting()
        .with_connect_endpoints([args[0]])
        .with_domain_id(0)
        .build()?;
    let node = ctx.create_node("probe").build()?;
    match args[1..] {
        ["pose", topic] => hear(&node, topic, QosProfile::default(), show_pose),
        ["late", topic] => {
            let durability = QosDurability::TransientLocal;
            hear(&node, topic, QosProfile { durability, ..Default::default() }, show_pose)
        }
        ["map", topic] => hear(&node, topic, QosProfile::default(), show_map),
        ["diagnostics", topic] => hear(&node, topic, QosProfile::default(), show_diagnostics),
        ["graph"] => loop {
            for (name, namespace) in ctx.graph().get_node_names() {
                println!("node {namespace} {name}");
            }
            for (topic, kind) in ctx.graph().get_topic_names_and_types() {
                println!("topic {topic} {kind}");
            }
            tokio::time::sleep(PERIOD).await;
        },
        ["drive", topic] => {
            let publisher = node.create_pub::<Odometry>(topic).build()?;
            let start = SystemTime::now();
            loop {
                let way = start.elapsed()?.as_secs_f64();
                let message =
                    Odometry { header: header("odom"), pose: pose(3.0 + way, 4.0, 0.1), ..Default::default() };
                publisher.publish(&message)?;
                tokio::time::sleep(PERIOD).await;
            }
        }
        ["place", topic, x, y, variance] => {
            let publisher = node.create_pub::<PoseWithCovarianceStamped>(topic).build()?;
            let place = pose(x.parse()?, y.parse()?, variance.parse()?);
            loop {
                publisher.publish(&PoseWithCovarianceStamped { header: header("map"), pose: place.clone() })?;
                tokio::time::sleep(PERIOD).await;
            }
        }
        ["garbage", topic] => {
            let publisher = node.create_pub::<Odometry>(topic).build()?;
            loop {
                publisher.publish_serialized(vec![0u8, 1, 0, 0, 255, 255, 255, 255])?;
                tokio::time::sleep(PERIOD).await;
            }
        }
        _ => Err("see the head of src/main.rs".into()),
    }
}

/// Print each message behind its key, and the number, the time and the publisher of its attachment.
fn hear<T>(node: &hiroz::node::ZNode, topic: &str, qos: QosProfile, show: fn(T) -> String) -> Result<()>
where
    T: ZMessage + WithTypeInfo + MessageTypeInfo + 'static,
    T::Serdes: for<'a> ZDeserializer<Input<'a> = &'a [u8], Output = T>,
{
    let subscriber = node.create_sub::<T>(topic).with_qos(qos).build()?;
    println!("READY");
    loop {
        let sample = subscriber.recv_serialized()?;
        let attachment: Attachment = sample.attachment().ok_or("no attachment")?.try_into()?;
        let gid: String = attachment.source_gid.iter().map(|byte| format!("{byte:02x}")).collect();
        let message = T::Serdes::deserialize(&sample.payload().to_bytes()).map_err(|error| error.to_string())?;
        let (sequence, time) = (attachment.sequence_number, attachment.source_timestamp);
        println!("{} {sequence} {time} {gid} {}", sample.key_expr(), show(message));
    }
}
