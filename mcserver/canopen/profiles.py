"""Device profiles (the low word of 1000h) by their numbers."""

from __future__ import annotations

from types import MappingProxyType

CIA_401, CIA_402 = 401, 402
PROFILES = MappingProxyType(
    {401: "inputs and outputs", 402: "drive", 404: "measuring device", 406: "encoder", 410: "inclinometer"}
)


def profile_text(profile: int) -> str:
    """Return what a device profile is, in words."""
    return PROFILES.get(profile, f"profile {profile}")


def device_text(device_type: int) -> str:
    """Name the device that 1000h describes, such as "a CiA 401 module (inputs and outputs)"."""
    profile = device_type & 0xFFFF
    if not profile:
        return "a device without a profile"
    return f"a CiA {profile} module" + (f" ({PROFILES[profile]})" if profile in PROFILES else "")
