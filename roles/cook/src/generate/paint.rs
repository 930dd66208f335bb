//! The paint of parts: one colour per purpose, as in plants, and the trade that would draw them.

use trimaran_scene::Rgba8;

/// The purpose of a part, which decides its colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Paint {
    Steel,
    Hull,
    Floor,
    Grating,
    Wall,
    Door,
    Water,
    Steam,
    Gas,
    Oil,
    Fire,
    Air,
    Fitting,
    Vessel,
    Machine,
    Tray,
    Cable,
    Cabinet,
    Duct,
    Rail,
    Furniture,
    Instrument,
}

impl Paint {
    /// The trades, in the order of a model's merged objects.
    pub(super) const TRADES: [&'static str; 9] = [
        "structure",
        "floors",
        "walls",
        "piping",
        "equipment",
        "electrical",
        "ducts",
        "access",
        "instruments",
    ];

    /// The paints of pipes.
    pub(super) const SERVICES: [Self; 6] =
        [Self::Water, Self::Steam, Self::Gas, Self::Oil, Self::Fire, Self::Air];

    pub(super) const fn colour(self) -> Rgba8 {
        let [r, g, b] = match self {
            Self::Steel => [122, 134, 150],
            Self::Hull => [128, 60, 52],
            Self::Floor => [104, 104, 98],
            Self::Grating => [148, 150, 148],
            Self::Wall => [214, 208, 192],
            Self::Door => [56, 108, 84],
            Self::Water => [58, 140, 84],
            Self::Steam => [188, 192, 196],
            Self::Gas => [204, 168, 66],
            Self::Oil => [132, 84, 50],
            Self::Fire => [196, 44, 40],
            Self::Air => [112, 170, 214],
            Self::Fitting => [84, 88, 96],
            Self::Vessel => [222, 220, 210],
            Self::Machine => [44, 92, 152],
            Self::Tray => [172, 176, 178],
            Self::Cable => [38, 38, 42],
            Self::Cabinet => [176, 182, 170],
            Self::Duct => [160, 168, 176],
            Self::Rail => [232, 190, 40],
            Self::Furniture => [156, 120, 82],
            Self::Instrument => [236, 236, 240],
        };
        Rgba8([r, g, b, 255])
    }

    /// The trade whose drawings show it; one of [`Self::TRADES`].
    pub(super) const fn trade(self) -> &'static str {
        match self {
            Self::Steel | Self::Hull => "structure",
            Self::Floor | Self::Grating => "floors",
            Self::Wall | Self::Door => "walls",
            Self::Water | Self::Steam | Self::Gas | Self::Oil | Self::Fire | Self::Air | Self::Fitting => {
                "piping"
            }
            Self::Vessel | Self::Machine | Self::Furniture => "equipment",
            Self::Tray | Self::Cable | Self::Cabinet => "electrical",
            Self::Duct => "ducts",
            Self::Rail => "access",
            Self::Instrument => "instruments",
        }
    }
}
