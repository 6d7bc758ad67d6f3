"""Random outfits: draw the clothes of a person, and put them on from the inside out.

Common cuts occur in every split. Some are reserved: the long sleeveless coat and curls for validation; the
full-length robe, afro hair and helmets for generalisation.
"""

from collections.abc import Callable

import numpy as np

from shadow.lightstage.people.accessories import footwear, glasses, hair, held, locks, props, seats
from shadow.lightstage.people.accessories.footwear import Shoe
from shadow.lightstage.people.cloth import fabric, tailoring
from shadow.lightstage.people.cloth.fabric import Fabric
from shadow.lightstage.people.cloth.garments import Wardrobe
from shadow.lightstage.people.cloth.patterns import Fit
from shadow.lightstage.people.makehuman import Look

HAIR = {"training": {}, "validation": {"curls": 3.0}, "generalisation": {"afro": 3.0}}
HATS = {"training": {}, "validation": {}, "generalisation": {"helmet": 1.5}}
OVER = {"training": {}, "validation": {"long vest": 3.0}, "generalisation": {}}
WHOLE = {"training": {}, "validation": {}, "generalisation": {"robe": 1.2}}

BOOT_LEG = 0.93  # a shoe whose shaft begins at a smaller share of the leg, from the hip, is a boot
HIGH_HEEL = 0.04  # metres from which a heel is high


def heel(rng: np.random.Generator, woman: bool) -> float:
    """Draw the height in metres of the heel above the ball of the foot: flat, low or high."""
    kind = pick(rng, {"flat": 6, "low": 2.5, "high": 2.5 * woman})
    heights = {"flat": 0.0, "low": rng.uniform(0.012, HIGH_HEEL), "high": rng.uniform(HIGH_HEEL, 0.085)}
    return heights[kind]


def pick(rng: np.random.Generator, chances: dict[str, float]) -> str:
    """Draw a key of `chances`, whose values are relative probabilities."""
    weights = np.array(list(chances.values()))
    return str(rng.choice(list(chances), p=weights / weights.sum()))


def dress(
    wardrobe: Wardrobe, rng: np.random.Generator, split: str, woman: bool, look: Look | None = None
) -> None:
    """Draw an outfit for the person of the wardrobe, and put it on. What `look` has replaces parts of it."""
    if look is not None and look.suit is not None:
        look.wear(wardrobe, look.suit)
        if look.shoes is not None:
            look.wear(wardrobe, look.shoes)
    else:
        _dress_body(wardrobe, rng, split, woman)
    if look is not None and look.hair is not None:
        look.wear(wardrobe, look.hair)
        if rng.random() < 0.25:
            wardrobe.parts += glasses.glasses(wardrobe.person, hair.Skull(wardrobe.person), rng)
    else:
        _dress_head(wardrobe, rng, split, woman)
    props.carry(wardrobe, rng, split)
    for side, thing in wardrobe.person.held.items():
        paint = fabric.leather(rng) if thing in ("bag", "case") else Fabric.plain(fabric.colour(rng))
        held.hold(wardrobe, rng, side, thing, paint)
    if wardrobe.person.seated and rng.random() < 0.85:
        seats.sit(
            wardrobe, rng, fabric.leather(rng) if rng.random() < 0.5 else Fabric.plain(fabric.colour(rng))
        )


def _dress_body(wardrobe: Wardrobe, rng: np.random.Generator, split: str, woman: bool) -> None:
    outfit = _Outfit(wardrobe, rng, split)
    whole = pick(rng, {"two pieces": 9, "dress": 2.5 * woman, **WHOLE[split]})
    shoe = outfit.footwear(woman)
    tall = shoe is not None and shoe.leg < BOOT_LEG
    tucked_in = tall and rng.random() < 0.6  # trousers in boots
    skirt = whole == "two pieces" and woman and rng.random() < 0.22
    in_boots = whole == "two pieces" and not skirt and tucked_in
    if not in_boots:
        outfit.shoes(shoe)
    if whole == "two pieces":
        tucked = rng.random() < (0.6 if skirt else 0.2)
        if tucked:
            outfit.top(tucked=True, woman=woman)
        if skirt:
            outfit.skirt()
        else:
            outfit.trousers(shoe if tall else None, in_boots)
        if in_boots:
            outfit.shoes(shoe)
        if rng.random() < (0.6 if tucked else 0.15) and not in_boots:
            outfit.belt()
        if not tucked:
            outfit.top(tucked=False, woman=woman)
    else:
        if whole == "dress" and rng.random() < 0.5:
            outfit.leggings()
        outfit.gown(whole)
    over = pick(rng, {"none": 10, "jacket": 3.5, "coat": 1.5, "hoodie": 2, "vest": 0.8, **OVER[split]})
    if whole != "robe" and over != "none":
        outfit.over(over)


class _Outfit:
    """Draws garments that suit one another, and puts them on one person."""

    def __init__(self, wardrobe: Wardrobe, rng: np.random.Generator, split: str) -> None:
        self.wardrobe, self.rng, self.split = wardrobe, rng, split
        head = wardrobe.person.skeleton.head
        self.waist = head("spine04")[1] + rng.uniform(-0.01, 0.04)
        self.hip = head("upperleg01.L")[1]
        self.loose = rng.beta(1.3, 1.8)
        self.crumpled = rng.uniform(0.3, 1.8) ** 1.3

    def cloth(self, only: Callable | None = None) -> Fabric:
        return fabric.draw(self.rng, self.split, only)

    def fit(self, loose: float, **choices: object) -> Fit:
        """Draw a fit by looseness in [0, 1], tight and thin to loose and thick; `choices` override it."""
        rng = self.rng
        common = dict(
            ease=0.004 + 0.018 * loose * rng.uniform(0.6, 1.2),
            fill=np.clip(loose + rng.normal() * 0.25, 0, 1),
            slack=1 + (0.01 + 0.05 * loose) * rng.random(),
            wrinkles=0.0014 * self.crumpled * (0.5 + loose),
            bending=rng.choice([0.05, 0.15, 0.3, 0.6]),
            thickness=rng.uniform(0.003, 0.006),
        )
        return Fit(**{**common, **choices})

    def footwear(self, woman: bool) -> Shoe | None:
        """Draw shoes for the heel of the pose; None is barefoot."""
        rng, heel = self.rng, self.wardrobe.person.heel
        if not heel and rng.random() < 0.05:
            return None
        high = heel > HIGH_HEEL
        kind = pick(
            rng, {"shoe": 8 * (not high), "boot": 2 + 2 * (heel > 0), "pump": 5 * woman * (heel > 0.02)}
        )
        if kind == "pump":
            thin = high and rng.random() < 0.6
            return Shoe(
                leg=0.93, low=True, ease=0.003, sole=rng.uniform(0.003, 0.01), pointed=rng.uniform(0, 0.02),
                tip=rng.uniform(0.2, 0.4) if thin else rng.uniform(0.6, 0.9),
            )  # fmt: skip
        boot = kind == "boot"
        return Shoe(
            leg=rng.uniform(0.55, 0.9) if boot else rng.uniform(0.97, 1.0),
            ease=rng.uniform(0.004, 0.009),
            shaft=rng.uniform(0.004, 0.016) if boot else 0.0,
            sole=rng.uniform(0.008, 0.03) if not heel else rng.uniform(0.005, 0.012),
            tip=rng.uniform(0.55, 0.98),
            pointed=rng.uniform(0, 0.012) if heel else 0.0,
        )

    def shoes(self, shoe: Shoe | None) -> None:
        if shoe is None:
            return
        rng, ground = self.rng, self.wardrobe.person.tights_rest[:, 1].min()
        leather = shoe.low or (shoe.leg < BOOT_LEG and rng.random() < 0.6)
        cloth = fabric.leather(rng) if leather else fabric.shoe(rng, ground + rng.uniform(0.004, 0.02))
        footwear.put_on(self.wardrobe, shoe, cloth, rng)

    def trousers(self, boots: Shoe | None, in_boots: bool) -> None:
        rng = self.rng
        kind = pick(rng, {"slim": 3, "straight": 4, "wide": 1.5, "shorts": 1.6, "leggings": 0.6})
        if in_boots:
            kind = "slim"
        elif kind == ("slim" if boots else "leggings" if self.wardrobe.person.pocketed else None):
            kind = "straight"  # wide enough for boots under them, or for a pocket
        if kind == "leggings":
            self.leggings()
            return
        leg = rng.uniform(0.93, 1.0)
        if kind == "shorts":
            leg = rng.uniform(0.22, 0.55)
        elif in_boots and boots is not None:
            leg = min(boots.leg + 0.07, 0.95)
        loose = {"slim": 0.1, "straight": 0.4, "wide": 0.8, "shorts": 0.5}[kind] + 0.2 * rng.random()
        width = {
            "slim": 0.7,
            "straight": rng.uniform(0.85, 1.1),
            "wide": rng.uniform(1.15, 1.55),
            "shorts": rng.uniform(0.95, 1.4),
        }[kind]
        jeans = rng.random() < 0.4
        only = fabric.denim if jeans else (fabric.plain if rng.random() < 0.6 else None)
        ironed = not jeans and kind in ("straight", "wide", "slim") and rng.random() < 0.5
        self.wardrobe.wear(
            self.fit(
                loose * 0.7,
                top=self.waist,
                leg=leg,
                leg_width=width,
                fill=0.0,
                held=("waist", "ankles") if in_boots else ("waist",),
                sewn=("waistband", "seat") if jeans or rng.random() < 0.5 else ("waistband",),
                crease=rng.uniform(0.004, 0.009) if ironed else 0.0,
            ),
            self.cloth(only),
        )

    def leggings(self) -> None:
        self.wardrobe.wear(
            self.fit(
                0.0,
                top=self.waist,
                leg=self.rng.uniform(0.6, 0.97),
                fill=0.0,
                ease=0.003,
                wrinkles=0.0003,
                held=("waist",),
                thickness=0.002,
            ),
            self.cloth(fabric.plain),
        )

    def skirt(self) -> None:
        rng = self.rng
        length = rng.uniform(0.3, 0.85)
        self.wardrobe.wear(
            self.fit(
                0.3,
                top=self.waist + 0.02,
                bottom=self.waist - 0.06,
                fill=0.2,
                below=length,
                flare=rng.choice([0.03, 0.1, 0.2, 0.3]),
                held=("waist",),
                pleats=int(rng.integers(18, 30)) if rng.random() < 0.35 else 0,
            ),
            self.cloth(),
        )

    def belt(self) -> None:
        """Put a belt on the garment that was put on last, at the waist."""
        if self.wardrobe.outer is None:
            return
        metal = Fabric.plain(self.rng.choice([0.12, 0.45]) * np.array([1.0, 0.92, 0.78]))
        width = self.rng.uniform(0.025, 0.045)
        at = self.waist - 0.02
        leather = fabric.leather(self.rng)
        self.wardrobe.parts += tailoring.belt(self.wardrobe.outer, at, width, leather, metal, self.rng)

    def tie(self) -> None:
        """Put a necktie on the shirt that was put on last."""
        if self.wardrobe.outer is None:
            return
        person = self.wardrobe.person
        self.wardrobe.parts += tailoring.tie(person, self.wardrobe.outer, self.cloth(), self.rng)

    def top(self, tucked: bool, woman: bool) -> None:
        rng = self.rng
        kind = pick(
            rng,
            {
                "t-shirt": 4,
                "shirt": 3,
                "long sleeves": 2.5,
                "tank": 0.8,
                "sweater": 2,
                "turtleneck": 0.6,
                "blouse": 1.0 * woman,
            },
        )
        loose = self.loose
        sleeve = {"t-shirt": rng.uniform(0.2, 0.42), "tank": None}.get(
            kind, rng.choice([rng.uniform(0.5, 0.8), 0.98], p=[0.25, 0.75])
        )
        choices = dict(
            neck=rng.uniform(0.01, 0.05),
            sleeve=sleeve,
            sleeve_width=rng.uniform(0.85, 1.3)
            if kind == "t-shirt"
            else 0.5 + 0.45 * loose + 0.1 * rng.random(),
            held=("neck",),
        )
        if kind == "shirt":
            choices |= dict(
                neck=0.012,
                collar=rng.uniform(0.028, 0.04),
                collar_kind="fold",
                vee=rng.choice([0, 0.06, 0.1]),
                buttons=True,
            )
            if rng.random() < 0.2:
                choices |= dict(collar_kind="stand")
            choices["sewn"] = ("placket", "cuffs") if sleeve > 0.9 else ("placket",)
            if rng.random() < 0.5:
                choices["sewn"] += ("chest",)
        elif kind == "turtleneck":
            choices |= dict(neck=-0.012, collar=0.03, collar_kind="fold")
            loose *= 0.4
        elif kind in ("blouse", "tank") or rng.random() < 0.2:
            choices |= dict(neck=0.03, vee=rng.uniform(0.06, 0.14))
        if kind == "sweater":
            loose = 0.4 + 0.6 * loose
            choices |= dict(thickness=0.007, bending=0.6)
        choices["below"] = 0.0 if tucked else rng.uniform(0.04, 0.16) + 0.12 * (loose > 0.7) * rng.random()
        bottom = self.waist - (0.05 if tucked else 0.09)
        fit = self.fit(loose, bottom=bottom, flare=rng.uniform(0.0, 0.12), **choices)
        if tucked:
            fit.held = ("neck", "hem")
            fit.fill *= 0.4
        self.wardrobe.wear(fit, self.cloth(fabric.knit if kind == "sweater" and rng.random() < 0.5 else None))
        if kind == "shirt" and rng.random() < (0.15 if woman else 0.4):
            self.tie()

    def gown(self, kind: str) -> None:
        rng = self.rng
        if kind == "robe":
            fit = self.fit(
                1.0,
                bottom=self.waist - 0.06,
                neck=0.03,
                vee=rng.uniform(0, 0.1),
                sleeve=0.98,
                sleeve_width=rng.uniform(1.3, 2.0),
                below=rng.uniform(0.8, 0.98),
                flare=0.1,
                held=("neck",),
            )
        else:
            fit = self.fit(
                0.3 * self.loose,
                bottom=self.waist - 0.03,
                neck=0.04,
                vee=rng.choice([0, rng.uniform(0.05, 0.12)]),
                sleeve=rng.choice([0.2, 0.35, 0.95]) if rng.random() < 0.7 else None,
                below=rng.uniform(0.4, 0.95),
                flare=rng.choice([0.05, 0.2, 0.35]),
                held=("neck",),
            )
        self.wardrobe.wear(fit, self.cloth())

    def over(self, kind: str) -> None:
        rng = self.rng
        loose = 0.45 + 0.5 * self.loose
        sleeve = None if "vest" in kind else 0.99
        choices = dict(
            ease=0.016 + 0.016 * loose,
            neck=0.03,
            sleeve=sleeve,
            sleeve_width=0.7 + 0.35 * loose * rng.random(),
            held=("neck",),
            bottom=self.waist - 0.08,
            thickness=rng.uniform(0.006, 0.01),
            bending=rng.choice([0.3, 0.6]),
            flare=rng.uniform(0.03, 0.15),
        )
        if kind == "hoodie":
            choices |= dict(collar=0.07, collar_kind="hood", below=rng.uniform(0.02, 0.1))
        else:
            choices |= dict(
                collar=rng.uniform(0.035, 0.06),
                collar_kind=str(rng.choice(["fold", "fold", "stand"])),
                below={
                    "jacket": rng.uniform(0.03, 0.18),
                    "coat": rng.uniform(0.3, 0.75),
                    "long vest": rng.uniform(0.4, 0.8),
                    "vest": 0.05,
                }[kind],
            )
        if rng.random() < (0.35 if kind == "hoodie" else 0.65):
            choices |= dict(
                buttons=kind != "hoodie" and rng.random() < 0.6, open_front=rng.uniform(0.02, 0.11), neck=0.02
            )
            choices["swing"] = rng.uniform(0.0, 0.07 if kind in ("coat", "long vest") else 0.035)
        if kind in ("jacket", "coat", "long vest"):
            choices["sewn"] = ("hips",) if rng.random() < 0.6 else ()
            if choices["collar_kind"] == "fold" and rng.random() < 0.75:
                choices["sewn"] += ("lapels",)
                if not choices.get("open_front"):
                    choices["vee"] = rng.uniform(0.14, 0.3)
        leather = kind == "jacket" and rng.random() < 0.25
        cloth = fabric.leather(rng) if leather else self.cloth(fabric.plain if rng.random() < 0.6 else None)
        self.wardrobe.wear(self.fit(loose, **choices), cloth)


def _dress_head(wardrobe: Wardrobe, rng: np.random.Generator, split: str, woman: bool) -> None:
    skull = hair.Skull(wardrobe.person)
    colour = fabric.hair(rng)
    styles = (
        {"short": 1, "bob": 2.5, "long": 4, "bun": 2, "ponytail": 2}
        if woman
        else {"bald": 0.7, "buzz": 2, "short": 6, "bob": 0.3, "long": 0.5, "bun": 0.2}
    )
    style = pick(rng, {**styles, **HAIR[split]})
    worn = pick(rng, {"none": 8, "beanie": 0.6, "cap": 0.8, "hat": 0.5, **HATS[split]})
    if worn != "none":
        style = "buzz" if style in ("short", "afro", "curls", "bun") else style
    if style != "bald":
        hair.grow(skull, wardrobe, rng, style, colour, pressed=worn != "none")
    if style == "short" and rng.random() < 0.5:
        wardrobe.parts.append(locks.tousled(skull, colour, rng))
    if worn == "none" and style in ("short", "bob", "long", "ponytail", "bun") and rng.random() < 0.3:
        wardrobe.parts.append(locks.fringe(skull, colour, rng))
    if worn != "none":
        cloth = fabric.draw(rng, split, fabric.knit if worn == "beanie" else fabric.plain)
        hair.hat(skull, wardrobe, rng, worn, cloth)
    if not woman and rng.random() < 0.3:
        hair.beard(skull, wardrobe, rng, colour)
    if worn not in ("hat", "helmet") and rng.random() < 0.25:
        wardrobe.parts += glasses.glasses(wardrobe.person, skull, rng)
