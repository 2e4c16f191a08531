#include <vtkCell.h>
#include <vtkNew.h>
#include <vtkObject.h>
#include <vtkPolyData.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLPolyDataReader.h>
#include <vtkXMLUnstructuredGridReader.h>

#include <stdexcept>

#include "meshing/surface_readers.h"

namespace testbed {
namespace {

/// The two-dimensional cells and the points they use; other cells (a frame's springs and tetrahedra) are
/// passed over.
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

  std::vector<std::vector<vtkIdType>> polygons;
  std::vector<bool> is_used(data->GetNumberOfPoints());
  for (vtkIdType c = 0; c < data->GetNumberOfCells(); ++c) {
    vtkCell* const cell = data->GetCell(c);
    if (cell->GetCellDimension() != 2) continue;
    std::vector<vtkIdType>& polygon = polygons.emplace_back();
    for (int k = 0; k < cell->GetNumberOfPoints(); ++k) polygon.push_back(cell->GetPointId(k));
    for (vtkIdType i : polygon) is_used[i] = true;
  }

  PolygonSoup soup;
  std::vector<int> new_index(is_used.size());
  for (vtkIdType i = 0; i < data->GetNumberOfPoints(); ++i)
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

}  // namespace testbed
