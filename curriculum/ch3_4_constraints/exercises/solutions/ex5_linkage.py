from pathlib import Path

SCENE = Path(__file__).with_name("my_linkage.json")


def ship():
    return "impulse"


def why():
    return "It flies in circles, so each step leaves them by more than a slow spring takes back."
