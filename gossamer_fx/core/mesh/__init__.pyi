from .mesh import Mesh as Mesh
from .mesh import gmsh_mesh as gmsh_mesh
from .mesh import read_mesh as read_mesh
