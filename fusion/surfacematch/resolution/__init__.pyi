from .noise import NoiseSpectrum as NoiseSpectrum
from .noise import estimate_spectrum as estimate_spectrum
from .resolution import blur as blur
from .resolution import estimate_blur as estimate_blur
from .transfer import Transfer as Transfer
from .transfer import estimate_transfer as estimate_transfer
