// vtk_worker: makes OFF of a VTK file in a process of its own, since VTK's readers crash, hang and take all memory on
// damaged files.
#include <signal.h>
#include <sys/prctl.h>
#include <vtkCell.h>
#include <vtkCellArray.h>
#include <vtkGenericCell.h>
#include <vtkNew.h>
#include <vtkObject.h>
#include <vtkPolyData.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLPolyDataReader.h>
#include <vtkXMLUnstructuredGridReader.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iostream>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

struct Cells {
  vtkCellArray* corners;
  vtkUnsignedCharArray* types;  ///< absent where all are polygons
};

Cells cells_of(vtkPolyData& data, const std::string& name) {
  if (data.GetNumberOfStrips() > 0)
    throw std::runtime_error(name + ": " + std::to_string(data.GetNumberOfStrips()) +
                             " triangle strips, expected polygons");
  return {data.GetPolys(), nullptr};
}

Cells cells_of(vtkUnstructuredGrid& grid, const std::string&) {
  return {grid.GetCells(), grid.GetCellTypesArray()};
}

/// -1 for a type that VTK does not know.
int dimension_of(int type) {
  const auto cell = vtkSmartPointer<vtkCell>::Take(vtkGenericCell::InstantiateCell(type));
  return cell ? cell->GetCellDimension() : -1;
}

/// The two-dimensional cells and the points they use; other cells (a frame's springs and tetrahedra) are
/// passed over. VTK checks neither types nor point ids.
template <class Reader>
void write_off(const std::string& name, std::ostream& off) {
  vtkObject::GlobalWarningDisplayOff();
  vtkNew<Reader> reader;
  reader->SetFileName(name.c_str());
  reader->Update();
  auto* const data = reader->GetOutput();
  if (reader->GetErrorCode() != 0 || !data || !data->GetPoints())
    throw std::runtime_error(name + ": cannot be read, expected a VTK XML file of this type with points");

  const vtkIdType n_points = data->GetNumberOfPoints();
  const Cells cells = cells_of(*data, name);
  const std::map<int, int> fewest_corners{{VTK_TRIANGLE, 3}, {VTK_POLYGON, 3}, {VTK_QUAD, 4}};
  std::map<int, int> dimensions;  // of the types met: to ask VTK takes longer than to read a cell
  std::vector<std::vector<vtkIdType>> polygons;
  std::vector<bool> is_used(n_points);
  for (vtkIdType c = 0; cells.corners && c < cells.corners->GetNumberOfCells(); ++c) {
    const auto fail = [&](const std::string& found, const std::string& expected) {
      throw std::runtime_error(name + (cells.types ? ": cell " : ": polygon ") + std::to_string(c) + " has " +
                               found + ", expected " + expected);
    };
    int type = VTK_POLYGON;
    if (cells.types) type = cells.types->GetValue(c);
    if (dimensions.count(type) == 0) dimensions[type] = dimension_of(type);
    if (dimensions[type] >= 0 && dimensions[type] != 2) continue;
    const auto fewest = fewest_corners.find(type);
    if (fewest == fewest_corners.end())
      fail("type " + std::to_string(type), "5, 7 or 9 (triangle, polygon, quadrilateral)");
    const bool is_polygon = type == VTK_POLYGON;
    vtkIdType n;
    const vtkIdType* corners;
    cells.corners->GetCellAtId(c, n, corners);
    if (n < fewest->second || (!is_polygon && n > fewest->second))
      fail(std::to_string(n) + " corner(s)",
           (is_polygon ? "at least " : "") + std::to_string(fewest->second));
    for (vtkIdType k = 0; k < n; ++k) {
      if (corners[k] < 0 || corners[k] >= n_points)
        fail("point " + std::to_string(corners[k]), "0 to " + std::to_string(n_points - 1));
      is_used[corners[k]] = true;
    }
    polygons.emplace_back(corners, corners + n);
  }

  off.precision(std::numeric_limits<double>::max_digits10);
  off << "OFF\n" << std::count(is_used.begin(), is_used.end(), true) << ' ' << polygons.size() << " 0\n";
  std::vector<vtkIdType> new_index(is_used.size());
  vtkIdType n_used = 0;
  for (vtkIdType i = 0; i < n_points; ++i)
    if (is_used[i]) {
      const double* const x = data->GetPoint(i);
      if (!(std::isfinite(x[0]) && std::isfinite(x[1]) && std::isfinite(x[2])))
        throw std::runtime_error(name + ": vertex " + std::to_string(i) +
                                 " has a coordinate that is not finite");
      new_index[i] = n_used++;
      off << x[0] << ' ' << x[1] << ' ' << x[2] << '\n';
    }
  for (const std::vector<vtkIdType>& polygon : polygons) {
    off << polygon.size();
    for (const vtkIdType i : polygon) off << ' ' << new_index[i];
    off << '\n';
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::cerr << "usage: " << argv[0] << " vtp|vtu FILE OFF (started by read_surface)\n";
    return 2;
  }
  prctl(PR_SET_PDEATHSIG, SIGKILL);  // not to outlive the program that waits
  const std::string type = argv[1], name = argv[2];
  try {
    std::ofstream off(argv[3]);
    if (type == "vtp")
      write_off<vtkXMLPolyDataReader>(name, off);
    else
      write_off<vtkXMLUnstructuredGridReader>(name, off);
    off.close();
    if (!off) throw std::runtime_error(name + ": its triangles cannot be written to " + argv[3]);
  } catch (const std::bad_alloc&) {
    std::cout << name << ": announces more than a file of its size holds";
    return 1;
  } catch (const std::exception& error) {
    std::cout << error.what();
    return 1;
  }
  return 0;
}
