from .locating import located_store as located_store
