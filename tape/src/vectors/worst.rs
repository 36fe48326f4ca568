//! Courses that a search has found to be worse than the random ones, on the Cortex-M7 (`.ci/wcet search`).

use super::Course;

/// The worst found of arms and classes, without repetitions. Beside each, what it was the worst of when it was found.
#[rustfmt::skip]
pub const WORST: [Course; 53] = [
    // UR10e (closed form)
    named("0035afba2fb1b54008eac051fe9ef069ce8662aa8707a35c6dea03d5"), // kernel alone
    named("00fb62d36dbd23cfd770a9ff08061e0a48493f713cfa249668fd1dc0"), // motion only
    named("00fb62ab6dbd23cf188d0bc909061e0ac2493f711a40245568581d55"), // + pose
    named("00fb61b46c7f24cfbb8da9c90906fa0ac249f0709efa24f968351d55"), // + rates
    named("006e1ddc79e6f8f1c177ac97008ceede9888f038b0696d9a8ec42223"), // + burst of poses
    named("009d844a12f5b9d8dae4de21010e92dfa4690438b0616c1bc94804c4"), // + replay
    named("00fb61ac6cbd24d0417f4fc90911fb0a54493fb526f9b2f968f51e55"), // fault
    named("00c6f9e21e333bfab462a98613cee3dac884a06ffd69da9caff75919"), // fault after a replay
    named("0036afba2fb1b6400752c051fe9ef019ceb362aa8707a4b46cc903d5"), // frames in
    // NJ130 (wrist, parallelogram)
    named("01dccad8960cdbf8c1371e8811f000c0c6c104fb551fce1d9079ec6f"), // kernel alone
    named("0104a1d52e05453fc6b97178a0097a0a6f01a1130d22942f0035df36"), // motion only
    named("0111027067d0e572d758337b160d3c6afc50e2ca7e9bf18cd9f15826"), // + pose
    named("01b902c367d0e5d106583e7b0a9ece6afc50e209bc9aa18bd9f0236e"), // + rates
    named("01e82ee51d0929c8e6967cbefe50622ff228470e5401c09bcfc2b591"), // + burst of poses
    named("01d8dde44c0929c8e5967bbe5d50b72f2028490e5e01c83b442c5991"), // + replay
    named("015cf6f78b19eb7f074245e19044a3d9e6a40790a681e3ce90af7cf7"), // fault
    named("01f8d3b7900e292b2cbeeab3cffbc40950a3b4108dc9f0af24aad27c"), // fault after a replay
    named("0140874157d251ffbfe384254c3bcfc282dc3eeee4576fc4c549e70d"), // frames in
    // KR 120 (wrist)
    named("0287309f5b24432dfcf96e7afdf4d0dda4868571b737dec2c6fc65f6"), // kernel alone
    named("02090b606ff4071dca758044605338ead5a95100c0a99937d0ddcb05"), // motion only
    named("0209a6c66ff4071dca388043a3534de9d8a95100c0a948bbd0ddcb81"), // + pose
    named("0209cd606ff4071dca4a8043605393ead8a95100c0a9b8bbd0ddcb81"), // + rates
    named("02635bdf75213103f47d1197aef0d41fd8a90d58c1191a729774ccef"), // + burst of poses
    named("02553dd978f2b51dad9e92b40439b63f2c5362a06da954c0b6445241"), // + replay
    named("02e4e99064bcb4185a013b8d43e2fbe900086ca293f96bcfe54fbd80"), // fault
    named("02f72a431d4b0fcade0edac411c08bf9b080e7173139a3e2af12a848"), // fault after a replay
    named("0211a8a57c0a9e460406a9394989e5d616f98b62c0fe2c9454704bed"), // frames in
    // no closed form (iteration)
    named("059204b92a1de558362968858190e0443692ad40cfc7cdb2c8bbfaaf"), // kernel alone
    named("051a77600ed8f57d9b9b279eed790c951986eb4c65a0e29ce8190d8c"), // motion only
    named("051cee4ba29e52bc531dbb2bb479741599d404393c82352782646a5d"), // + pose
    named("051a77600ed9f57dc8ec629eec79d296b886d34c65a0e19c4f190d8c"), // + rates
    named("05d66bb2774ff787b024f70331c1fe0f30003e32f55002e220f5869e"), // + burst of poses
    named("053afbd55518baff4ad3375ee34f768f1323b53d776277f050e30ebc"), // + replay
    named("056e1fcba5f5f736e796b005353228f7e8c6d109330881d49bde93b5"), // fault after a replay
    named("056e1fcba5f4f736e796b005353228f7e8c6d109330881d49bde93b5"), // frames in
    // gantry, 4 joints
    named("06a3fa1037629a3c00b61c5cef90502d82a4a2f9b61f94929fe4da04"), // kernel alone
    named("068fec46ab58b047d2357004efe34fe1aaa2a02af7ccd1159ad16d24"), // motion only
    named("0638ec2fadbad79d6c06126957a42ea9cc24d6a549e8aeca8e1c19db"), // + pose
    named("06d883c90deeb38cc7a2fa4ce4c3ce3a02889c80512c7f7fe7ebd231"), // + rates
    named("06212ec42f61dfa9c28933bbc6a68f0f0c90e3528e79db245ffb6954"), // + burst of poses
    named("062235c42f61df13a58933bb0ea68f0fa490e22e8e79da24602a6955"), // + replay
    named("06577557adbb33bc6cf9129b564ecda9cc2433a549397eca781719db"), // fault
    named("06f337ccc61cd93a4938cc4d4521ae998ce005eedd51a61f4d151873"), // fault after a replay
    named("06212dc42f61df8cc29633bbc6a68f0f6e90e3528279db245f2a6954"), // frames in
    // crane with NJ130, 9 joints
    named("07681ae8a0212788ebd066e0aae880a9cc60ad0a437f94b2cfd5bb7b"), // kernel alone
    named("07d45df7361e332186e4e3f2a62c16ca1a62bc6c057df1dfa090d15f"), // motion only
    named("07d4a9dc3667ef2386e3e146a6ea09ca1a79d86cf87df1dfa006d15e"), // + pose
    named("07d4a9f7361e332286e5e2eaa64bd4ca1a62946cf8aff0dfa0a9d15e"), // + rates
    named("077b5f200e22e56c7fd5cce6f07bf50fb001e468d809501456b13b78"), // + burst of poses
    named("07ddbf210ef5471dfa1acca48b7bf50fb001e48cd80a5014ccb13b78"), // + replay
    named("07d3a9f7d71e331718e4e246a64bd3ca1a62956cf909f138a0aad15e"), // fault
    named("071be48b2416b5e1de3ff0c1011fb4496775378132f9333b09192e77"), // fault after a replay
    named("07b35f640ef5476c8e19cce58b7bf50fb001e48cd80a5014cdb13b78"), // frames in
];

/// A name that is wrong does not build.
const fn named(name: &str) -> Course {
    match Course::named(name) {
        Some(course) => course,
        None => panic!("not the name of a course"),
    }
}
