from .store import ScanStore as ScanStore
