//! Computes the torques of the drivetrain's test bench: which torque acts on which inertia, so that
//! torque and speed follow the scenario. Also gives the torques that references and drives measure,
//! and the power.

use loadtwin_machine::{Drivetrain, Load, Machine, Senses};

use crate::drivetrain_plant::{Drive, LAG, Plant};
use crate::drivetrain_scenario::{Demand, Profile};

/// Bandwidth of the speed control [rad/s].
const BANDWIDTH: f64 = 3.0;

/// The same where the first load itself holds the speed: slow, so that it does not hide a torque
/// that is given.
const BANDWIDTH_OF_LOAD: f64 = 0.3;

/// The first load follows the torque of the scenario. The second one holds
/// the speed; where there is none, the first measured drive does, and where
/// there is none of these either, the load itself does, as far as drag and
/// acceleration need it. Where the torque that holds the speed was measured it
/// is done again, and the speed is only kept from drifting away.
pub(crate) struct Bench {
    profile: Profile,
    torque: Actuator,
    speed: Actuator,
    held_by: HeldBy,
    nominal_speed: f64,
    /// The demand now.
    demand: Demand,
    /// The torque at the start, part of nominal.
    first: f64,
}

/// A torque on one inertia.
#[derive(Clone, Copy)]
struct Actuator {
    inertia: usize,
    /// Referred torque of one newton metre of its own.
    factor: f64,
    /// Its own nominal torque [N m].
    nominal: f64,
}

/// Which torque holds the speed.
#[derive(Clone, Copy, PartialEq, Eq)]
enum HeldBy {
    SecondLoad,
    Drive,
    FirstLoad,
}

impl Actuator {
    fn of(drivetrain: &Drivetrain, load: &Load) -> Self {
        let inertia = place(drivetrain, &load.inertia);
        Self {
            inertia,
            factor: load.direction.sign() * drivetrain.inertias[inertia].speed_ratio,
            nominal: load.nominal_nm,
        }
    }
}

/// Where the inertia of that name is; the description was checked.
pub(crate) fn place(drivetrain: &Drivetrain, name: &str) -> usize {
    drivetrain
        .inertias
        .iter()
        .position(|i| i.name == name)
        .unwrap_or(0)
}

impl Bench {
    pub(crate) fn new(machine: &Machine, drivetrain: &Drivetrain, profile: Profile) -> Self {
        let torque = Actuator::of(drivetrain, &drivetrain.loads[0]);
        let driven = machine.channels.iter().find_map(|c| match &c.senses {
            Senses::Drive(name) => Some(place(drivetrain, name)),
            _ => None,
        });
        let (held_by, speed) = match (drivetrain.loads.get(1), driven) {
            (Some(second), _) => (HeldBy::SecondLoad, Actuator::of(drivetrain, second)),
            (None, Some(inertia)) => {
                let factor = drivetrain.inertias[inertia].speed_ratio;
                (
                    HeldBy::Drive,
                    Actuator {
                        inertia,
                        factor,
                        nominal: torque.nominal,
                    },
                )
            }
            (None, None) => (HeldBy::FirstLoad, torque),
        };
        let demand = profile.at(0.0);
        Self {
            profile,
            torque,
            speed,
            held_by,
            nominal_speed: drivetrain.nominal_speed_rad_s,
            demand,
            first: demand.torque,
        }
    }

    /// The inertia whose speed is held.
    pub(crate) fn held(&self) -> usize {
        self.speed.inertia
    }

    /// Bandwidth of the speed control [rad/s].
    pub(crate) fn bandwidth(&self) -> f64 {
        if self.held_by == HeldBy::FirstLoad {
            BANDWIDTH_OF_LOAD
        } else {
            BANDWIDTH
        }
    }

    /// What acts on the plant now, were the demand to stay as it is.
    pub(crate) fn steady(&self, plant: &Plant) -> Drive {
        self.drive(plant, self.demand, Demand::default())
    }

    /// What acts on the plant now and at `t`, `dt` from now; it becomes now.
    pub(crate) fn advance(&mut self, plant: &Plant, t: f64, dt: f64) -> (Drive, Drive) {
        let (now, next) = (self.demand, self.profile.at(t));
        let rate = now.rate_to(&next, dt);
        self.demand = next;
        (self.drive(plant, now, rate), self.drive(plant, next, rate))
    }

    /// What acts on the plant at `demand`, which changes by `rate` a second.
    fn drive(&self, plant: &Plant, demand: Demand, rate: Demand) -> Drive {
        let speed = demand.speed * self.nominal_speed;
        let torque = self.torque.factor * self.own_torque(demand);
        let mut drive = Drive::at_speed(speed);
        drive.load(self.torque.inertia, torque);
        if let Some(held) = demand.held {
            // The lag of the torque loop is made up for.
            let ahead = LAG * rate.held.unwrap_or(0.0);
            drive.feed = self.speed.factor * self.speed.nominal * (held + ahead);
            return drive;
        }
        let acceleration = rate.speed * self.nominal_speed;
        drive.feed = plant.drag(speed) + plant.inertia() * acceleration;
        if self.held_by != HeldBy::FirstLoad {
            drive.feed -= torque;
        }
        drive
    }

    /// What the scenario puts on the first load [N m].
    fn own_torque(&self, demand: Demand) -> f64 {
        let part = match (self.held_by, demand.held) {
            // What holds the speed is the whole load.
            (HeldBy::FirstLoad, Some(_)) => 0.0,
            // A load that also holds the speed starts in balance.
            (HeldBy::FirstLoad, None) => demand.torque - self.first,
            _ => demand.torque,
        };
        self.torque.nominal * part
    }

    /// Load number `i` now [N m].
    pub(crate) fn load(&self, plant: &Plant, i: usize) -> f64 {
        let held = plant.drive() / self.speed.factor;
        match (i, self.held_by) {
            (0, HeldBy::FirstLoad) => self.own_torque(self.demand) + held,
            (0, _) => self.own_torque(self.demand),
            _ => held,
        }
    }

    /// Torque of the measured drive on inertia `i` now [N m].
    pub(crate) fn measured_drive(&self, plant: &Plant, i: usize) -> f64 {
        if self.held_by == HeldBy::Drive && i == self.speed.inertia {
            plant.drive() / self.speed.factor
        } else {
            0.0
        }
    }

    /// Magnitude of the power that goes through the machine, part of nominal.
    pub(crate) fn power(&self, plant: &Plant) -> f64 {
        let torque = self.load(plant, 0) / self.torque.nominal;
        (torque * plant.speed_of(self.torque.inertia) / self.nominal_speed).abs()
    }
}
