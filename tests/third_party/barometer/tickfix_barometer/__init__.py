"""Dead reckoning from steps, with the change of height that the air pressure shows."""

import math
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from tickfix.api import BasePdr, hookimpl, parameter
from tickfix.toolkit.step_signal import StepDetectorState, StepErrorParams, detect_steps, motion_from_steps

TICKFIX_API = 1

SCALE_HEIGHT_M = 8434.0  # R·T/(M·g) of dry air at 288.15 K: dh = −H·d(ln p)
POSSIBLE_HPA = (300.0, 1100.0)  # from above Everest to below the Dead Sea: anything else is a broken sensor


@dataclass(frozen=True)
class BarometerParams(StepErrorParams):
    """Parameters of ``barometer``."""

    smoothing_s: Annotated[float, parameter("time constant of the pressure's smoothing", unit="s", gt=0)] = 0.5
    noise_hpa: Annotated[float, parameter("σ of a single pressure", unit="hPa", ge=0)] = 0.02
    step_length_m: Annotated[float, parameter("length of a step", unit="m", gt=0)] = 0.7


@dataclass(frozen=True)
class BarometerState:
    """Gait, the logarithm of the smoothed pressure, when it was measured, and what was walked."""

    gait: StepDetectorState = field(default_factory=StepDetectorState)
    log_hpa: float | None = None
    t_ns: int = 0
    travelled_m: float = 0.0


class BarometerPdr(BasePdr):
    """Steps of one length, and the change of height by the barometric formula."""

    name = "barometer"
    source = "barometric formula of the ICAO standard atmosphere"
    Params = BarometerParams
    State = BarometerState

    def start(self):
        return BarometerState()

    def step(self, state, samples):
        gait, steps = state.gait, []
        accelerometer = samples.sensors.get("accelerometer")
        if accelerometer is not None:
            gait, steps = detect_steps(gait, accelerometer, low_pass_hz=2.0, threshold=0.4, min_step_interval_s=0.3)
        motion = motion_from_steps(
            samples,
            [self.params.step_length_m] * len(steps),
            self.params,
            heading_rad=None,
            turn_rad=0.0,
            stationary=False,
            travelled_before_m=state.travelled_m,
        )
        after = replace(state, gait=gait, travelled_m=motion.travelled_m)
        pressure = samples.sensors.get("pressure")
        if pressure is not None:
            after = self._smooth(after, pressure)
            if state.log_hpa is not None and after.t_ns != state.t_ns:
                motion = replace(
                    motion,
                    height_change_m=SCALE_HEIGHT_M * (state.log_hpa - after.log_hpa),
                    height_change_sigma_m=SCALE_HEIGHT_M * self.params.noise_hpa / math.exp(after.log_hpa),
                )
        return after, motion

    def _smooth(self, state, pressure):
        low, high = POSSIBLE_HPA
        log_hpa, t_ns = state.log_hpa, state.t_ns
        for now_ns, hpa in zip(pressure.t_ns.tolist(), np.ravel(pressure.values).tolist(), strict=True):
            if not low <= hpa <= high:
                continue
            dt = (now_ns - t_ns) * 1e-9
            gain = 1.0 if log_hpa is None else 1.0 - math.exp(-dt / self.params.smoothing_s)
            log_hpa = math.log(hpa) if log_hpa is None else log_hpa + gain * (math.log(hpa) - log_hpa)
            t_ns = now_ns
        return replace(state, log_hpa=log_hpa, t_ns=t_ns)


@hookimpl
def tickfix_register():
    return [BarometerPdr]
