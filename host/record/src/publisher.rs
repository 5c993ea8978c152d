//! Publishes stored messages and the latest health of a machine to an MQTT broker on a thread of
//! its own, connects again where the connection is lost, and acknowledges in the store what the
//! broker has.
//!
//! After each connection all messages that are not acknowledged are sent again, in order.

use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use rumqttc::{
    Client, Connection, Event, LastWill, MqttOptions, NetworkOptions, Outgoing, Packet, QoS,
};

use super::broker::Broker;
use super::message_store::MessageStore;

/// Messages under way at most.
const WINDOW: usize = 50;

/// Ping interval; a broker that does not answer within it is gone.
const KEEP_ALIVE: Duration = Duration::from_secs(5);

/// Longest time for a connection (s).
const CONNECTION_S: u64 = 5;

/// Pause before the next attempt.
const PAUSE: Duration = Duration::from_secs(1);

/// Time for the remaining messages at the end.
const END: Duration = Duration::from_secs(3);

/// Largest message (bytes).
const LARGEST: usize = 64 << 10;

/// State of a machine whose recorder does not run, or is not reached.
const OFFLINE: &str = r#"{"state":"offline"}"#;

/// What both threads share.
pub struct Shared {
    /// Messages until they are acknowledged.
    pub store: Mutex<MessageStore>,
    /// Health that is to be published.
    pub health: Mutex<Option<String>>,
    /// The recorder ends.
    pub ending: AtomicBool,
}

/// The value, also after a panic of the other thread.
pub fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Where and as whom.
pub struct Publisher<'a> {
    /// The broker.
    pub broker: Broker,
    /// Name of this client at the broker.
    pub client: String,
    /// Topic of the health.
    pub health_topic: String,
    /// What is shared with the recorder.
    pub shared: &'a Shared,
}

/// One connection.
struct Session<'a> {
    publisher: &'a Publisher<'a>,
    client: Client,
    connection: Connection,
    is_connected: bool,
    /// Last message handed over.
    submitted: u64,
    /// Sequences handed over, in order; none for health.
    queue: VecDeque<Option<u64>>,
    under_way: BTreeMap<u16, Option<u64>>,
    health: Option<String>,
}

impl Publisher<'_> {
    /// Publishes until the recorder ends; `warn` reports connections that are lost.
    pub fn run(&self, warn: &(dyn Fn(&str) + Sync)) {
        let mut was_lost = false;
        while !self.shared.ending.load(Ordering::Relaxed) {
            match Session::new(self).run(&mut was_lost, warn) {
                Ok(()) => return,
                Err(error) => {
                    if !was_lost {
                        warn(&format!("{:?}: {error}; messages are stored", self.broker));
                    }
                    was_lost = true;
                    thread::sleep(PAUSE);
                }
            }
        }
    }

    fn options(&self) -> MqttOptions {
        let mut options = MqttOptions::new(&self.client, &self.broker.host, self.broker.port);
        options.set_keep_alive(KEEP_ALIVE);
        options.set_inflight(2 * WINDOW as u16);
        options.set_max_packet_size(LARGEST, LARGEST);
        let topic = self.health_topic.as_str();
        options.set_last_will(LastWill::new(topic, OFFLINE, QoS::AtLeastOnce, true));
        if let Some((user, password)) = &self.broker.user {
            options.set_credentials(user, password);
        }
        options
    }
}

impl<'a> Session<'a> {
    fn new(publisher: &'a Publisher<'a>) -> Self {
        let (client, mut connection) = Client::new(publisher.options(), 2 * WINDOW);
        let mut network = NetworkOptions::new();
        network.set_connection_timeout(CONNECTION_S);
        connection.eventloop.set_network_options(network);
        Self {
            submitted: locked(&publisher.shared.store).acknowledged(),
            publisher,
            client,
            connection,
            is_connected: false,
            queue: VecDeque::new(),
            under_way: BTreeMap::new(),
            health: None,
        }
    }

    fn run(mut self, was_lost: &mut bool, warn: &(dyn Fn(&str) + Sync)) -> Result<(), String> {
        let mut ends = None;
        loop {
            // A connection is given up when its wait ends.
            let wait = if self.is_connected {
                Duration::from_millis(50)
            } else {
                Duration::from_secs(CONNECTION_S + 1)
            };
            match self.connection.recv_timeout(wait) {
                Ok(Ok(event)) => self.take(&event)?,
                Ok(Err(error)) => return Err(error.to_string()),
                Err(_) if self.is_connected => {}
                Err(_) => return Err("no connection".to_owned()),
            }
            if self.is_connected && *was_lost {
                warn(&format!("{:?}: connected again", self.publisher.broker));
                *was_lost = false;
            }
            if !self.is_connected {
                continue;
            }
            self.submit()?;
            if self.publisher.shared.ending.load(Ordering::Relaxed) {
                let end = *ends.get_or_insert_with(|| Instant::now() + END);
                let is_done = locked(&self.publisher.shared.store).waiting() == 0;
                if is_done || Instant::now() > end {
                    return self.end();
                }
            }
        }
    }

    /// Hands over what is new.
    fn submit(&mut self) -> Result<(), String> {
        let room = WINDOW.saturating_sub(self.queue.len() + self.under_way.len());
        if room == 0 {
            return Ok(());
        }
        let health = locked(&self.publisher.shared.health).clone();
        if let Some(health) = health.filter(|health| self.health.as_ref() != Some(health)) {
            self.publish(None, &self.publisher.health_topic, true, health.clone())?;
            self.health = Some(health);
        }
        let messages = {
            let store = locked(&self.publisher.shared.store);
            store.after(self.submitted, room)
        };
        for message in messages.map_err(|error| error.to_string())? {
            self.publish(
                Some(message.sequence),
                &message.topic,
                false,
                message.payload,
            )?;
            self.submitted = message.sequence;
        }
        Ok(())
    }

    fn publish(
        &mut self,
        sequence: Option<u64>,
        topic: &str,
        retain: bool,
        payload: String,
    ) -> Result<(), String> {
        (self.client)
            .try_publish(topic, QoS::AtLeastOnce, retain, payload)
            .map_err(|error| error.to_string())?;
        self.queue.push_back(sequence);
        Ok(())
    }

    fn take(&mut self, event: &Event) -> Result<(), String> {
        match event {
            Event::Incoming(Packet::ConnAck(_)) => self.is_connected = true,
            Event::Outgoing(Outgoing::Publish(id)) => {
                if let Some(sequence) = self.queue.pop_front() {
                    self.under_way.insert(*id, sequence);
                }
            }
            Event::Incoming(Packet::PubAck(ack)) => {
                self.under_way.remove(&ack.pkid);
                let waiting = self.under_way.values().chain(&self.queue).flatten().min();
                let acknowledged = waiting.map_or(self.submitted, |first| first - 1);
                let mut store = locked(&self.publisher.shared.store);
                store
                    .acknowledge(acknowledged)
                    .map_err(|error| error.to_string())?;
            }
            _ => {}
        }
        Ok(())
    }

    fn end(mut self) -> Result<(), String> {
        self.publish(None, &self.publisher.health_topic, true, OFFLINE.to_owned())?;
        let end = Instant::now() + END;
        while !(self.queue.is_empty() && self.under_way.is_empty()) && Instant::now() < end {
            match self.connection.recv_timeout(Duration::from_millis(50)) {
                Ok(Ok(event)) => self.take(&event)?,
                Ok(Err(error)) => return Err(error.to_string()),
                Err(_) => {}
            }
        }
        let _ = self.client.try_disconnect();
        let _ = self.connection.recv_timeout(Duration::from_millis(200));
        Ok(())
    }
}
