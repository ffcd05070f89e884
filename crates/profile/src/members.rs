//! Lists of members by owner, such as the signals of each device. Lookups need no search through all members.

use std::sync::OnceLock;

/// Members by the index of their owner, for example the signals of each device. Each pair is the index of the owner and
/// of the member.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Members(Vec<(usize, usize)>);

impl FromIterator<(usize, usize)> for Members {
    /// Collects pairs of an owner and its member, in any order.
    fn from_iter<I: IntoIterator<Item = (usize, usize)>>(pairs: I) -> Members {
        let mut pairs: Vec<(usize, usize)> = pairs.into_iter().collect();
        pairs.sort_unstable();
        pairs.dedup();
        Members(pairs)
    }
}

impl Members {
    /// Iterates over the indices of the members of one owner. Each index occurs once, in ascending order.
    pub fn of(&self, owner: usize) -> impl Iterator<Item = usize> + Clone {
        let first = self.0.partition_point(|(known, _)| *known < owner);
        self.0[first..].iter().take_while(move |(known, _)| *known == owner).map(|(_, member)| *member)
    }
}

/// Devices of each bus, and signals of each device. The lists are built when they are first needed.
///
/// A clone of a profile builds its own lists, because its tables may be changed before its lists are needed.
#[derive(Debug, Default)]
pub struct ProfileMembers(OnceLock<Lists>);

#[derive(Debug)]
pub(crate) struct Lists {
    pub(crate) devices: Members,
    pub(crate) signals: Members,
}

impl ProfileMembers {
    /// Returns the lists. The first call builds them with `collect`.
    pub(crate) fn lists(&self, collect: impl FnOnce() -> Lists) -> &Lists {
        self.0.get_or_init(collect)
    }
}

impl Clone for ProfileMembers {
    fn clone(&self) -> ProfileMembers {
        ProfileMembers::default()
    }
}

/// Treats all member lists as equal. They are calculated from the tables of the profile, and these tables are
/// compared themselves.
impl PartialEq for ProfileMembers {
    fn eq(&self, _: &ProfileMembers) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::{BusId, DeviceId, Profile, parse};

    #[test]
    fn each_owner_has_its_members_once_in_ascending_order() {
        let members: Members = [(3, 9), (1, 4), (3, 2), (1, 4), (0, 7)].into_iter().collect();
        let of = |owner| members.of(owner).collect::<Vec<_>>();
        assert_eq!([of(0), of(1), of(2), of(3), of(4)], [vec![7], vec![4], vec![], vec![2, 9], vec![]]);
        assert_eq!(Members::default().of(0).next(), None);
    }

    #[test]
    fn a_changed_clone_of_a_profile_has_its_own_members() {
        let text = "[machine]\nname = \"two\"\n[bus.a]\ntype = \"modbus-tcp\"\naddress = \"127.0.0.1:502\"\n\
                    [bus.b]\ntype = \"modbus-tcp\"\naddress = \"127.0.0.2:502\"\n[device.one]\nbus = \"b\"\nunit = 1\n\
                    [device.two]\nbus = \"a\"\nunit = 1\n[signal.s]\ndevice = \"two\"\nregister = \"input:0\"\n\
                    type = \"i16\"\n[signal.t]\ndevice = \"one\"\nregister = \"input:0\"\ntype = \"i16\"\n\
                    [signal.u]\ndevice = \"two\"\nregister = \"input:1\"\ntype = \"i16\"\n";
        let loaded = parse(Path::new("two.toml"), text, &[], &[]);
        let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
        let of = |profile: &Profile| {
            let devices = |bus| profile.devices_on(BusId(bus)).map(|(id, _)| id.0).collect::<Vec<_>>();
            let signals =
                |device| profile.signals_of(DeviceId(device)).map(|(id, _)| id.0).collect::<Vec<_>>();
            [devices(0), devices(1), signals(0), signals(1)]
        };
        assert_eq!(of(&profile), [vec![1], vec![0], vec![1], vec![0, 2]]);
        let mut changed = profile.clone();
        changed.signals[0].device = DeviceId(0);
        changed.devices[0].bus = BusId(0);
        assert_eq!(of(&changed), [vec![0, 1], vec![], vec![0, 1], vec![2]]);
        assert_eq!(of(&profile), [vec![1], vec![0], vec![1], vec![0, 2]]);
    }
}
