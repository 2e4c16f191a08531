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

#include <map>
#include <stdexcept>

#include "meshing/surface/surface_readers.h"

namespace testbed::meshing {
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
PolygonSoup read_cells(std::string_view bytes, const std::string& name) {
  vtkObject::GlobalWarningDisplayOff();
  vtkNew<Reader> reader;
  reader->ReadFromInputStringOn();
  reader->SetInputString(std::string(bytes));
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

  PolygonSoup soup;
  std::vector<int> new_index(is_used.size());
  for (vtkIdType i = 0; i < n_points; ++i)
    if (is_used[i]) {
      new_index[i] = static_cast<int>(soup.points.size());
      soup.points.emplace_back(data->GetPoint(i));
    }
  for (const std::vector<vtkIdType>& polygon : polygons) {
    std::vector<int> corners;
    for (vtkIdType i : polygon) corners.push_back(new_index[i]);
    soup.add_polygon(corners);
  }
  return soup;
}

}  // namespace

PolygonSoup read_vtp(std::string_view bytes, const std::string& name) {
  return read_cells<vtkXMLPolyDataReader>(bytes, name);
}

PolygonSoup read_vtu(std::string_view bytes, const std::string& name) {
  return read_cells<vtkXMLUnstructuredGridReader>(bytes, name);
}

}  // namespace testbed::meshing
