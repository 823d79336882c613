from pathlib import Path

SCENE = Path(__file__).with_name("my_linkage.json")


def ship():
    return "impulse"
