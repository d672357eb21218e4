"""Sentences: several of them about one person, said in one; and one that says several things, taken apart."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence

_WHO = "a person|someone|the person|a man|a woman|a human|he|she|they"
SUBJECT = re.compile(rf"^({_WHO}) (?=\w)")
"""What the sentences of the collection begin with."""
JOINTS = (", then ", " and then ", ", and then ", ", and after that ")
"""Between one thing and the next; a plain "and" as well, where neither has one of its own."""
_RESTS = re.compile(
    rf"^(?:{_WHO}) (?:just |simply )?"
    r"(?:stands(?! up)|is (?:standing(?! up)|sitting(?! down)|seated|waiting|idle|still)|sits(?! down)|rests|waits"
    r"|(?:stays|remains) (?:seated|sitting|standing|still|in place))\b(?!.*\band (?!waits|does nothing))"
)
"""What says no more than that somebody is at rest."""
_TURNED = 0.4
"""Share of the sentences that say "after" or "before", where they can."""
_VERB = re.compile(r"^(?P<how>\w+ly )?(?:is (?P<doing>\w+ing)|(?P<verb>(?!is\b)\w+s))\b(?P<rest>.*)$")
"""A verb in the present, third person, first or behind an adverb."""
_ACTION = re.compile(rf"(?!(?:arms|hands|legs|feet|knees|elbows|fingers|shoulders)\b){_VERB.pattern[1:]}")
"""A verb that may follow a comma, where nouns in the plural stand, too."""
_MORE = re.compile(r" and | then |[,;]| (is|are) |\b(starts|stops|begins|keeps|continues) (to|\w+ing)\b")
"""What shows that there is a second verb."""
_THEN = re.compile(r",? and then |,? and after that |, then | then |; ")
"""What says that one thing comes after another."""
_LISTED = re.compile(r",? and |, ")
"""What stands between the things of a list."""
_ORDER = re.compile(
    r"(?:please )?(?:\w+ly )?(?:walk|run|jog|go|step|sidestep|turn|stop|stand|rise|get up|sit|crouch|duck|squat|kneel"
    r"|climb|jump|hop|wave|bow|nod|clap|point|reach|lean|bend|pick|grab|take|lift|carry|bring|put|place|set|raise|lower|throw"
    r"|kick|punch|dance|wait|look)\b"
)
"""A verb in the imperative, first."""
_ENDS = re.compile(
    r"(?:\w+ly )?(?:stop|halt|bow|nod|duck|jump|climb|pick|put|place|set|grab|take|drop|lift|throw|kick|punch|rise"
    r"|(?:sit|lie|kneel|squat|bend)s? down|(?:stand|get)s? up|turns? (?:around|back))(?:s|es)?\b"
)
"""What is done at some moment, so that nothing else goes on through it."""
_AFTER = re.compile(r"^after (?P<one>\w+ing\b[^,]*), (?P<rest>.+)$")
_TURN = re.compile(r"^(?P<some>.+?),? (?P<how>after|before) (?P<other>(?:\w+ly )?\w+ing\b.*)$")
_DOUBLED = re.compile(r"[^aeiou]*(qu)?[aeiou][^aeiouwxy]")
"""Verbs of one short syllable, whose last letter is doubled: sit, run, stop, squat."""
_NOUN = r"(?:something|an? (?!seat\b|step\b)\w+(?: (?!(?:up|down|low|with|in|on|onto|from|off|to|and|behind)\b)\w+)*)"
_HANDLED = re.compile(rf"\b(?:carr|hold|pick|tak|put|lift|set|plac|lay)\w*(?: up| down)? (?P<thing>{_NOUN})")
_SEATED = re.compile(
    rf"\b(?:sits|sitting|seated|rests|rises|stands up|gets up) (?:\w+ly )?(?:on|from) (?P<thing>{_NOUN})"
)
_SITS_DOWN = re.compile(rf"\b(?:sits down|takes a seat|lowers (?:themselves|the body))\b(?: onto? (?P<thing>{_NOUN}))?")
_RISES = re.compile(r"(?:rises|stands up|gets up)\b")
_SITS = re.compile(r"(?:sits|is sitting|is seated)(?: on [\w ]+)?")
_GOES = re.compile(r"(?:\w+ly )?(?:walk|run|jog|sneak|stride|march)s")


def in_one(captions: Sequence[Sequence[str]], most: int = 6) -> tuple[str, ...]:
    """Sentences that say several things in their order: "a person walks forward, then sits down".

    Some turn the order of the words and not that of the things: "after walking forward, a person sits down". About half
    of them leave out a rest at the beginning or end: who sits down may have stood before, and sits after.

    Args:
        captions: of each thing, sentences that say it.
        most: how many are made, each of other sentences and joined in another way; equal ones count once.
    """
    draw = random.Random("|".join(text for texts in captions for text in texts))
    busy = [i for i, texts in enumerate(captions) if not all(map(_RESTS.search, texts))]
    made = list[str]()
    for _ in range(most):
        told = captions[busy[0] : busy[-1] + 1] if busy and draw.random() < 0.5 else captions
        again = [texts in told[:i] for i, texts in enumerate(told)]
        made.append(_joined([draw.choice(list(texts)) for texts in told], again, draw))
    return tuple(dict.fromkeys(made))


def _joined(texts: Sequence[str], again: Sequence[bool], draw: random.Random) -> str:
    first, *rest = (text.strip().rstrip(".") for text in texts)
    subject = SUBJECT.match(first)
    plain = [SUBJECT.sub("", text) for text in (first, *rest)]
    things = _in_context(plain, again)
    begun, ended = doing(things[0]), doing(things[-1])
    said = ""
    if rest and subject and draw.random() < _TURNED:
        who = subject[0]
        ways = [f"after {begun}, {who}{_listed(things[1:], draw)}"] if begun else []
        turned = begun and len(things) == 2 and doing(things[1]) and things == plain  # nothing is "it" before its name
        ways += [f"{who}{things[1]} after {begun}"] if turned else []
        ways += [f"{who}{_listed(things[:-1], draw)} before {ended}"] if ended else []
        said = draw.choice(ways) if ways else ""
    return f"{said or _listed([first, *things[1:]], draw)}."


def _in_context(things: Sequence[str], again: Sequence[bool]) -> list[str]:
    """What is said of somebody one after the other: things named before are "it", who walked before walks on.

    Args:
        things: sentences without their subjects.
        again: which of them say what one before has said.
    """
    said: list[str] = []
    held, sitting, seat = "", False, False  # a seat that has a name
    for text, repeated in zip(things, again, strict=True):
        if repeated and (goes := _GOES.match(text)):
            text = f"{goes[0]} on"
        if sitting and _SITS.fullmatch(text):
            text = "stays seated"
        if found := _HANDLED.search(text):
            text = _it(text, found) if found["thing"] == held else text
            held = found["thing"]
        on = _SEATED.search(text)
        if down := _SITS_DOWN.search(text):
            sitting, seat = True, down["thing"] is not None
        elif on:
            text = _it(text, on) if seat else text
            sitting, seat = not _RISES.match(text), not _RISES.match(text)
        said.append(text)
    return said


def _it(text: str, found: re.Match[str]) -> str:
    return f"{text[: found.start('thing')]}it{text[found.end('thing') :]}"


def _listed(texts: Sequence[str], draw: random.Random) -> str:
    said = texts[0]
    for i, text in enumerate(texts[1:], start=2):
        plain = not re.search(r" and |, ", said + text)
        joint = ", " if i < len(texts) and draw.random() < 0.5 else draw.choice((*JOINTS, " and ") if plain else JOINTS)
        said += joint + text
    return said


def apart(text: str) -> tuple[str, ...]:
    """Sentences for the things that one sentence says one after another; the sentence itself where it says one.

    The order is said by "then", "after" and "before", by commas between verbs, or by a plain "and" beside what
    is done at some moment ("walks and sits down"). Other things with a plain "and" between them may be done at once
    ("crouches and walks"), and stay together.
    """
    plain = text.strip().rstrip(".")
    if turned := _AFTER.match(plain):
        who = SUBJECT.match(turned["rest"])
        return (f"{who[0]}is {turned['one']}.", *apart(f"{turned['rest']}.")) if who else (text,)
    who = SUBJECT.match(plain)
    verb, said = (_ACTION, plain[who.end() :]) if who else (_ORDER, plain)
    turn = _TURN.match(said) if who else None
    things = [part for thing in _THEN.split(turn["some"] if turn else said) for part in _listed_verbs(thing, verb)]
    if turn:
        things.insert(0 if turn["how"] == "after" else len(things), f"is {turn['other']}")
    if len(things) == 1 or not all(map(verb.match, things)):
        return (text,)
    return tuple(f"{who[0] if who else ''}{thing}." for thing in things)


def _listed_verbs(said: str, verb: re.Pattern[str]) -> list[str]:
    """The things of a list, each of which begins with a verb, where they can't be done at once; else one."""
    parts, begin, commas = list[str](), 0, False
    for joint in _LISTED.finditer(said):
        if verb.match(said[joint.end() :]):
            parts.append(said[begin : joint.start()])
            begin, commas = joint.end(), commas or "," in joint[0]
    parts.append(said[begin:])
    return parts if commas or any(map(_ENDS.match, parts)) else [said]


def also(text: str, how: str) -> str:
    """A sentence, or a title without a subject, and something else that is done meanwhile ("waves")."""
    text = text.strip().rstrip(".")
    return f"{text} and {how}." if SUBJECT.match(text) else f"{text}, {doing(how) or how}."


def doing(text: str) -> str | None:
    """What somebody does, as a participle: "walks forward" is "walking forward".

    None for what says more than one thing, or is no verb in the third person.
    """
    found = _VERB.match(text)
    if found is None or _MORE.search(text):
        return None
    return f"{found['how'] or ''}{found['doing'] or _participle(found['verb'])}{found['rest']}"


def _participle(verb: str) -> str:
    """ "walks" -> "walking", "sits" -> "sitting", "waves" -> "waving", "carries" -> "carrying"."""
    if verb.endswith("ies") and len(verb) > 4:  # and not "lies"
        stem = f"{verb[:-3]}y"
    elif re.search(r"((ch|sh|ss|x|zz)|^(go|do))es$", verb):
        stem = verb[:-2]
    else:
        stem = verb[:-1]
    if stem.endswith("ie"):
        return f"{stem[:-2]}ying"
    if stem.endswith("e") and not stem.endswith(("ee", "oe", "ye")):
        stem = stem[:-1]
    elif _DOUBLED.fullmatch(stem):
        stem += stem[-1]
    return f"{stem}ing"
