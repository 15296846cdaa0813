from .las import read_las_system as read_las_system
from .las_writer import write_las as write_las
